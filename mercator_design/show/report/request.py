"""The request: the mission, the method, the budget."""

import base64
import io

from mercator_design.results.experiments.preview import MissionPreview
from mercator_design.results.facts import Facts
from mercator_design.show.report.markup import Html, facts_list, figure, row_of, section

_DPI = 160
_COLOURS = 128  # of the picture: few are needed, and it gets three times smaller


def request(facts: Facts) -> Html:
    """The section of the request."""
    start, asked, model = facts.start, facts.mission, facts.robot_model
    mission: list[tuple[str, object]] = [("mission" if start["task"] == "mission" else "scenario", start["name"])]
    picture = Html()
    if asked is not None and model is not None:
        mission += [
            ("", asked.description or None),
            ("robots", f"{asked.robots} of {model.name}"),
            ("duration", f"{asked.duration:g} s"),
            ("objectives" if asked.objectives else "objective", asked.goal),
        ]
        picture = Html() if facts.preview is None else _picture(facts.preview)
    race: list[tuple[str, object]] = [
        ("flavour", start.get("flavour")),
        ("method", start["method"]),
        ("budget", f"{facts.record.budget} experiments"),
        ("extended from", ", ".join(map(str, facts.record.budgets[:-1])) or None),
        ("seed", start["seed"]),
        ("changed keys", ", ".join((facts.provenance and facts.provenance.request.set) or ()) or None),
    ]
    made = facts.command("missions", "show", file="mission.yaml") if picture else ""
    return section("request", "What was asked", row_of(facts_list([*mission, *race]), picture), command=made)


def _picture(preview: MissionPreview) -> Html:
    """The mission from above."""
    from PIL import Image

    from mercator_design.show.pictures.figures import house_style
    from mercator_design.show.pictures.preview import draw_preview

    drawn, file = io.BytesIO(), io.BytesIO()
    with house_style():
        draw_preview(preview).savefig(drawn, format="png", dpi=_DPI)
    Image.open(drawn).convert("RGB").quantize(_COLOURS).save(file, format="PNG", optimize=True)
    data = base64.b64encode(file.getvalue()).decode()
    image = f'<img alt="The mission from above" src="data:image/png;base64,{data}">'
    return figure(image, "The mission from above, with the start of the race's first instance.")
