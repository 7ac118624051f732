"use strict";
// The comparison of designs. The address of the page has all that it shows, so it can be kept and sent.
(() => {
  const { api, at, make } = Mercator;
  const SIDE_BY_SIDE = 3;
  const maxChosen = Number(at("chosen").dataset.max);
  let chosen = []; // { kind: job | design | fsm, value }

  const called = ({ kind, value }) => {
    if (kind === "fsm") return value;
    const option = [...at("design").options].find((one) => one.value === `${kind}:${value}`);
    return option ? option.text : `${kind} ${value}`;
  };

  function show() {
    at("chosen").replaceChildren(...chosen.map((one, k) => make("li", {},
      make("span", { dir: "auto" }, `${k + 1}. ${called(one)}`),
      make("button", { type: "button", "aria-label": `Remove ${called(one)}`, onclick: () => { chosen.splice(k, 1); show(); } }, "Remove"))));
    at("run").disabled = chosen.length < 2;
    at("add").disabled = chosen.length >= maxChosen;
    const link = new URLSearchParams(chosen.map(({ kind, value }) => [kind, value]));
    if (at("mission").value) link.append("mission", at("mission").value);
    for (const id of ["runs", "seed"]) link.append(id, at(id).value);
    history.replaceState(null, "", `?${link}`);
  }

  function mission() {
    if (at("mission").value) return Mercator.given(at("mission").value);
    const first = chosen.find(({ kind }) => kind !== "fsm");
    if (!first) throw new Error("Choose a mission: an FSM as text has none.");
    return { [first.kind]: first.value };
  }

  async function run() {
    at("results").replaceChildren();
    at("run").disabled = true;
    at("progress").textContent = `Running ${chosen.length} designs on ${at("runs").value} instances …`;
    try {
      const fsms = chosen.map((one, k) => ({ [one.kind]: one.value, name: `${k + 1}. ${one.kind === "fsm" ? "text" : called(one)}`.slice(0, 100) }));
      const on = mission();
      const data = await api("POST", "/fsms/evaluate", { mission: on, fsms, runs: Number(at("runs").value), seed: Number(at("seed").value) });
      const stage = make("div", { id: "replay" });
      const picks = fsms.map((one, k) => make("input", { type: "checkbox", id: `pick-${k}`, checked: k < 2 }));
      const instance = make("select", { id: "instance" }, ...data.seeds.slice(0, 100).map((seed, k) => make("option", { value: seed }, `${k + 1}: instance of seed ${seed}`)));
      const replay = async () => {
        const shown = fsms.filter((_, k) => picks[k].checked).slice(0, SIDE_BY_SIDE);
        for (const pick of picks) pick.disabled = !pick.checked && shown.length >= SIDE_BY_SIDE;
        if (!shown.length) stage.asked = null;
        else await Mercator.replay(stage, { mission: on, fsms: shown, seed: Number(instance.value) });
      };
      for (const one of [...picks, instance]) one.addEventListener("change", replay);
      at("results").replaceChildren(
        make("section", {}, make("h2", {}, "Scores"), Mercator.evaluation(data)),
        make("section", {}, make("h2", {}, "Replays"), make("p", { class: "faint" }, `Up to ${SIDE_BY_SIDE} side by side, on the same instance.`),
          make("div", { class: "actions run" },
            make("div", {}, make("label", { for: "instance" }, "Instance"), instance),
            ...fsms.map((one, k) => make("label", { class: "check" }, picks[k], one.name))),
          stage));
      await replay();
    } catch (error) {
      at("results").replaceChildren(Mercator.problem(error));
    }
    at("progress").textContent = "";
    at("run").disabled = chosen.length < 2;
  }

  const asked = new URLSearchParams(location.search);
  chosen = [...asked].filter(([kind]) => ["job", "design", "fsm"].includes(kind)).slice(0, maxChosen).map(([kind, value]) => ({ kind, value }));
  for (const id of ["mission", "runs", "seed"]) if (asked.get(id)) at(id).value = asked.get(id);
  at("adding").addEventListener("submit", (event) => {
    event.preventDefault();
    if (at("design").value) {
      const [kind, value] = Object.entries(Mercator.given(at("design").value))[0];
      chosen.push({ kind, value });
    }
    if (at("pasted").value.trim() && chosen.length < maxChosen) chosen.push({ kind: "fsm", value: at("pasted").value.trim() });
    at("design").value = at("pasted").value = "";
    show();
  });
  at("running").addEventListener("submit", (event) => {
    event.preventDefault();
    run();
  });
  for (const id of ["mission", "runs", "seed"]) at(id).addEventListener("change", show);
  show();
  if (chosen.length >= 2) run();
})();
