"""A study with a mission and control software in files of its own."""

from mercator_design.config import shipped

OWN = """
schema: 1
name: own files
budgets: [20]
repetitions: 2
methods: {random: {method: random}, hand: {files: [made/by-hand.txt]}}
missions: [short.yaml, {mission: short.yaml, name: longer, set: [duration=2]}]
assess: {runs: 3}
"""
OWN_TOTAL = 2 * (2 * (20 + 3) + 3)
FILES = {
    "short.yaml": shipped.missions()["aggregation"]
    .read_text()
    .replace("duration: 120", "duration: 1")
    .replace("robots: 3", "robots: 2"),
    "made/by-hand.txt": "# of: hand\n--nstates 1 --s0 0 --rwm0 20\n",
}
