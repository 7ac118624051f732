"use strict";
// The FSM editor. The machine that is drawn is `machine`; the service checks it after each change, and draws it.
(() => {
  const { api, at, make } = Mercator;
  const KEPT = "fsm"; // the draft
  const MAX_HISTORY = 100;

  let modules = null; // of the flavour
  let machine = { flavour: "watermelon", states: [] };
  let selected = null; // { state } or { state, transition }
  let past = [], future = [], lastEdit = "";
  let origin = ""; // what the page has started from
  let number = 0; // of the latest check
  let isRunning = false;

  /* ---- The machine ---- */

  const moduleOf = (kind, name) => modules[kind].find((one) => one.name === name);
  const fresh = (module) => Object.fromEntries(module.parameters.map((one) => [one.name, one.words.length ? one.words[0] : one.middle]));
  const newState = (name) => ({ name: "", behaviour: name, parameters: fresh(moduleOf("behaviours", name)), transitions: [] });

  /** The usual names: the behaviour, with a number if several states have it. */
  function usualNames(states) {
    return states.map(({ behaviour }, k) => {
      const same = states.filter((one) => one.behaviour === behaviour).length;
      return same > 1 ? `${behaviour} ${states.slice(0, k + 1).filter((one) => one.behaviour === behaviour).length}` : behaviour;
    });
  }

  function names() {
    const usual = usualNames(machine.states);
    return machine.states.map((state, k) => state.name || usual[k]);
  }

  /** The machine as the service reads it: an fsm.yaml as data. */
  function structure() {
    const called = names();
    return {
      schema: 1,
      flavour: machine.flavour,
      states: machine.states.map((state, k) => ({
        name: called[k], behaviour: state.behaviour, ...state.parameters,
        transitions: state.transitions.map((one) => ({ condition: one.condition, to: called[one.to], ...one.parameters })),
      })),
    };
  }

  /** A machine from what `structure` makes. */
  function ofStructure(data) {
    const called = data.states.map((state) => state.name), usual = usualNames(data.states);
    return {
      flavour: data.flavour,
      states: data.states.map(({ name, behaviour, transitions = [], ...parameters }, k) => ({
        name: name === usual[k] ? "" : name, behaviour, parameters,
        transitions: transitions.map(({ condition, to, ...others }) => ({ condition, parameters: others, to: called.indexOf(to) })),
      })),
    };
  }

  /* ---- Changes ---- */

  /** Change the machine; changes of one kind in a row are undone together. */
  function edit(change, kind = "") {
    const before = JSON.stringify(machine);
    if (!kind || kind !== lastEdit) {
      past.push(before);
      past = past.slice(-MAX_HISTORY);
    }
    [lastEdit, future] = [kind, []];
    change();
    show(!kind);
  }

  async function travel(from, to) {
    if (!from.length) return;
    to.push(JSON.stringify(machine));
    machine = JSON.parse(from.pop());
    lastEdit = "";
    if (machine.flavour !== modules.flavour) await loadModules(machine.flavour);
    show();
  }
  const undo = () => travel(past, future);
  const redo = () => travel(future, past);

  function replace(next, { keepHistory = true } = {}) {
    if (keepHistory) past.push(JSON.stringify(machine));
    [machine, future, lastEdit] = [next, [], ""];
    selected = machine.states.length ? { state: 0 } : null;
    show();
  }

  function addState() {
    if (machine.states.length >= modules.max_states) return;
    edit(() => {
      const unused = modules.behaviours.find((one) => machine.states.every((state) => state.behaviour !== one.name));
      machine.states.push(newState((unused || modules.behaviours[0]).name));
      selected = { state: machine.states.length - 1 };
    });
  }

  function addTransition(from, to) {
    if (from === to || machine.states[from].transitions.length >= modules.max_transitions) return;
    edit(() => {
      const condition = modules.conditions[0];
      machine.states[from].transitions.push({ condition: condition.name, parameters: fresh(condition), to });
      selected = { state: from, transition: machine.states[from].transitions.length - 1 };
    });
  }

  function remove({ state, transition }) {
    edit(() => {
      if (transition !== undefined) {
        machine.states[state].transitions.splice(transition, 1);
        selected = { state };
        return;
      }
      machine.states.splice(state, 1);
      for (const one of machine.states) {
        one.transitions = one.transitions.filter(({ to }) => to !== state);
        for (const edge of one.transitions) if (edge.to > state) edge.to -= 1;
      }
      selected = machine.states.length ? { state: Math.max(0, state - 1) } : null;
    });
  }

  function makeInitial(state) {
    edit(() => {
      const order = [state, ...machine.states.keys()].filter((k, place) => place === 0 || k !== state);
      const states = order.map((k) => machine.states[k]);
      for (const one of states) for (const edge of one.transitions) edge.to = order.indexOf(edge.to);
      machine.states = states;
      selected = { state: 0 };
    });
  }

  /* ---- The form of the selected part ---- */

  function select(part) {
    selected = part;
    mark();
    form();
  }

  const choice = (id, entries, value, change) => make("select", { id, onchange: (event) => change(event.target.value) },
    ...entries.map(([key, words]) => make("option", { value: key, selected: String(key) === String(value) }, words)));
  const field = (id, words, ...parts) => make("div", { class: "field" }, make("label", { for: id }, words), ...parts);
  const button = (words, action, more = {}) => make("button", { type: "button", onclick: action, ...more }, words);

  /** A list of modules; one that the flavour does not have stays in it. */
  function modulesFor(kind, value) {
    const known = modules[kind].map((one) => [one.name, one.name]);
    return known.some(([name]) => name === value) ? known : [...known, [value, `${value} (not of ${machine.flavour})`]];
  }

  function parameterField(one, owner, where) {
    const id = `parameter-${one.name}`, value = owner.parameters[one.name];
    const words = `${one.name}${one.unit ? ` [${one.unit}]` : ""}: ${one.description}`;
    const set = (next) => edit(() => (owner.parameters[one.name] = next), `${where}.${one.name}`);
    if (one.words.length) return field(id, words, choice(id, one.words.map((word) => [word, word]), value, set));
    const common = { min: one.low, max: one.high, step: one.integer ? 1 : (one.high - one.low) / 100, value };
    const type = make("input", { id, type: "number", ...common, step: one.integer ? 1 : "any", "aria-describedby": `${id}-domain` });
    const slide = make("input", { type: "range", ...common, "aria-label": `${one.name}, by slider`, tabindex: "-1" });
    type.addEventListener("input", () => {
      slide.value = type.value;
      set(type.value === "" ? "" : Number(type.value));
    });
    slide.addEventListener("input", () => {
      type.value = String(Number(Number(slide.value).toPrecision(6)));
      set(Number(type.value));
    });
    const domain = `${one.integer ? "a whole number" : "a number"} from ${one.low} to ${one.high}`;
    return field(id, words, make("div", { class: "pair" }, slide, type), make("small", { class: "faint", id: `${id}-domain` }, domain));
  }

  function form() {
    const focused = document.activeElement && at("part").contains(document.activeElement) ? document.activeElement.id : "";
    const called = names();
    const parts = machine.states.flatMap((state, k) => [
      [`${k}`, `State ${k}: ${called[k]}`],
      ...state.transitions.map((edge, j) => [`${k}-${j}`, `   ${called[k]} → ${called[edge.to]}: ${edge.condition}`]),
    ]);
    if (!selected) {
      at("part").replaceChildren(make("p", { class: "faint" }, "Nothing is selected. Add a state to begin."));
      return;
    }
    const key = selected.transition === undefined ? `${selected.state}` : `${selected.state}-${selected.transition}`;
    const which = field("which", "Selected part", choice("which", parts, key, (value) => {
      const [state, transition] = value.split("-").map(Number);
      select(transition === undefined ? { state } : { state, transition });
    }));
    const content = selected.transition === undefined ? stateForm(selected.state, called) : transitionForm(selected, called);
    at("part").replaceChildren(which, ...content);
    if (focused && at(focused)) at(focused).focus();
  }

  function stateForm(k, called) {
    const state = machine.states[k], module = moduleOf("behaviours", state.behaviour);
    const isFull = state.transitions.length >= modules.max_transitions;
    const others = called.map((name, other) => [other, name]).filter(([other]) => other !== k);
    const name = make("input", { id: "state-name", value: state.name, placeholder: called[k], maxlength: "40", autocomplete: "off" });
    name.addEventListener("input", () => edit(() => (state.name = name.value.trim()), `${k}.name`));
    name.addEventListener("change", () => form());
    return [
      make("h2", {}, `State ${k}${k ? "" : " (initial)"}`),
      field("behaviour", "Behaviour", choice("behaviour", modulesFor("behaviours", state.behaviour), state.behaviour, (value) => edit(() => {
        Object.assign(state, { behaviour: value, parameters: fresh(moduleOf("behaviours", value)) });
      }))),
      ...(module ? [make("p", { class: "faint" }, module.description), ...module.parameters.map((one) => parameterField(one, state, k))] : []),
      field("state-name", "Name (optional)", name),
      ...(others.length ? [
        field("target", isFull ? `It has ${modules.max_transitions} transitions, the most` : "Add a transition to", make("div", { class: "pair" },
          choice("target", others, others[0][0], () => {}),
          button("Add", () => addTransition(k, Number(at("target").value)), { id: "add-transition", disabled: isFull }))),
      ] : []),
      make("div", { class: "actions" },
        button("Make it the initial state", () => makeInitial(k), { id: "make-initial", disabled: k === 0 }),
        button("Delete the state", () => remove({ state: k }), { class: "danger", id: "delete-part" })),
    ];
  }

  function transitionForm({ state, transition }, called) {
    const edge = machine.states[state].transitions[transition], module = moduleOf("conditions", edge.condition);
    const others = called.map((name, other) => [other, name]).filter(([other]) => other !== state);
    return [
      make("h2", {}, `Transition ${transition} of ${called[state]}`),
      field("condition", "Condition", choice("condition", modulesFor("conditions", edge.condition), edge.condition, (value) => edit(() => {
        Object.assign(edge, { condition: value, parameters: fresh(moduleOf("conditions", value)) });
      }))),
      ...(module ? [make("p", { class: "faint" }, module.description), ...module.parameters.map((one) => parameterField(one, edge, `${state}-${transition}`))] : []),
      field("to", "Leads to", choice("to", others, edge.to, (value) => edit(() => (edge.to = Number(value))))),
      make("div", { class: "actions" }, button("Delete the transition", () => remove({ state, transition }), { class: "danger", id: "delete-part" })),
    ];
  }

  /* ---- The diagram ---- */

  const partOf = (node) => {
    if (node.dataset.state !== undefined) return { state: Number(node.dataset.state) };
    const [state, transition] = node.dataset.transition.split("-").map(Number);
    return { state, transition };
  };
  const isSame = (one, other) => one && other && one.state === other.state && one.transition === other.transition;
  const nodes = () => [...at("diagram").querySelectorAll("[data-state], [data-transition]")];

  function mark() {
    for (const node of nodes()) {
      const is = isSame(partOf(node), selected);
      node.classList.toggle("active", is);
      if (node.hasAttribute("role")) node.setAttribute("aria-pressed", String(is));
    }
  }

  function draw(svg) {
    const held = document.activeElement && document.activeElement.closest && document.activeElement.closest("#diagram [role=button]");
    const focused = held ? partOf(held) : null;
    const picture = Mercator.svg(svg), called = names();
    picture.setAttribute("role", "group");
    at("diagram").replaceChildren(picture);
    for (const node of nodes()) {
      const part = partOf(node);
      if (part.transition !== undefined && !node.querySelector("text")) continue; // the line; its label is the button
      const edge = part.transition === undefined ? null : machine.states[part.state].transitions[part.transition];
      for (const line of node.querySelectorAll("text")) line.after(" "); // lines are words apart, also for who hears them
      const shown = node.textContent.trim();
      const words = edge ? `${shown}, transition from ${called[part.state]} to ${called[edge.to]}` : `${shown}, state`;
      for (const [name, value] of Object.entries({ tabindex: "0", role: "button", "aria-label": words })) node.setAttribute(name, value);
      if (isSame(part, focused)) node.focus();
    }
    mark();
  }

  /** Dragging from a state to another one draws a transition. */
  function listen() {
    let pull = null;
    const stateAt = (event) => {
      const hit = document.elementFromPoint(event.clientX, event.clientY);
      return hit && hit.closest("#diagram [data-state]");
    };
    const place = (event) => {
      const picture = at("diagram").querySelector("svg");
      return new DOMPoint(event.clientX, event.clientY).matrixTransform(picture.getScreenCTM().inverse());
    };
    at("diagram").addEventListener("pointerdown", (event) => {
      const node = event.target.closest("[data-state]");
      if (!node || event.button) return;
      const begin = place(event);
      const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
      line.setAttribute("class", "pull");
      for (const [name, value] of [["x1", begin.x], ["y1", begin.y], ["x2", begin.x], ["y2", begin.y]]) line.setAttribute(name, value);
      if (event.target.hasPointerCapture && event.target.hasPointerCapture(event.pointerId)) event.target.releasePointerCapture(event.pointerId);
      pull = { from: Number(node.dataset.state), line, x: event.clientX, y: event.clientY, isMoved: false };
    });
    addEventListener("pointermove", (event) => {
      if (!pull) return;
      if (!pull.isMoved && Math.hypot(event.clientX - pull.x, event.clientY - pull.y) < 6) return;
      if (!pull.isMoved) at("diagram").querySelector("svg").append(pull.line);
      pull.isMoved = true;
      const end = place(event), over = stateAt(event);
      pull.line.setAttribute("x2", end.x);
      pull.line.setAttribute("y2", end.y);
      for (const node of at("diagram").querySelectorAll("[data-state]")) node.classList.toggle("over", node === over && Number(node.dataset.state) !== pull.from);
    });
    const end = (event) => {
      if (!pull) return;
      const { from, line, isMoved } = pull;
      pull = null;
      line.remove();
      for (const node of at("diagram").querySelectorAll(".over")) node.classList.remove("over");
      const over = event.type === "pointerup" && isMoved ? stateAt(event) : null;
      if (over) addTransition(from, Number(over.dataset.state));
    };
    addEventListener("pointerup", end);
    addEventListener("pointercancel", end);
    at("diagram").addEventListener("click", (event) => {
      const node = event.target.closest("[data-state], [data-transition]");
      if (node) select(partOf(node));
    });
    at("diagram").addEventListener("keydown", (event) => {
      const node = event.target.closest("[role=button]");
      if (!node) return;
      if (["Enter", " "].includes(event.key)) select(partOf(node));
      else if (["Delete", "Backspace"].includes(event.key)) remove(partOf(node));
      else return;
      event.preventDefault();
    });
    addEventListener("keydown", (event) => {
      if (!(event.ctrlKey || event.metaKey) || /^(INPUT|TEXTAREA)$/.test(event.target.tagName)) return;
      const key = event.key.toLowerCase();
      if (key === "z" && !event.shiftKey) undo();
      else if (key === "y" || key === "z") redo();
      else return;
      event.preventDefault();
    });
  }

  /* ---- What the service says ---- */

  const mission = () => Mercator.given(at("mission").value);

  async function check() {
    const own = ++number;
    if (!machine.states.length) {
      at("diagram").replaceChildren(button("Add a state", addState, { class: "main" }));
      at("notes").replaceChildren();
      at("text").value = at("words").textContent = "";
      return;
    }
    at("diagram").classList.add("is-old");
    let found;
    try {
      const narrow = matchMedia("(max-width: 720px)").matches;
      found = await api("POST", "/fsms/check", { fsm: structure(), mission: mission(), narrow });
    } catch (error) {
      found = { valid: false, errors: [error.message], findings: [] };
    }
    if (own !== number) return; // there is a later one
    at("run").disabled = isRunning || !found.valid;
    const lines = found.errors.map((one) => make("li", { class: "problem" }, one));
    lines.push(...found.findings.map((one) => make("li", { class: one.is_note ? "faint" : "" }, `${one.place}: ${one.message}`)));
    at("notes").replaceChildren(...(lines.length ? [make("ul", {}, ...lines)] : []));
    if (!found.valid) return;
    at("diagram").classList.remove("is-old");
    draw(found.diagram);
    at("text").value = machine.states.some((state) => state.name) ? found.yaml : found.text;
    at("text-problem").textContent = "";
    at("words").textContent = found.explanation;
  }

  let waiting = null;
  function show(hasNewForm = true) {
    at("undo").disabled = !past.length;
    at("redo").disabled = !future.length;
    at("add-state").disabled = machine.states.length >= modules.max_states;
    at("flavour").value = machine.flavour;
    at("run").disabled = isRunning || !machine.states.length;
    if (selected && !machine.states[selected.state]) selected = machine.states.length ? { state: 0 } : null;
    if (selected && selected.transition !== undefined && !machine.states[selected.state].transitions[selected.transition]) selected = { state: selected.state };
    if (hasNewForm) form();
    keep();
    clearTimeout(waiting);
    waiting = setTimeout(check, hasNewForm ? 0 : 120);
  }

  function keep() {
    const settings = Object.fromEntries(["mission", "rival", "runs", "seed"].map((id) => [id, at(id).value]));
    Mercator.keepDraft(KEPT, JSON.stringify({ machine, origin, ...settings }));
  }

  /** Whether something is a machine: another version of this page may have kept something else. */
  function isMachine({ flavour, states }) {
    const isPart = (one, name) => typeof one[name] === "string" && typeof one.parameters === "object";
    return [...at("flavour").options].some((one) => one.value === flavour) && states.every((state) => isPart(state, "behaviour") &&
      state.transitions.every((edge) => isPart(edge, "condition") && states[edge.to] && states[edge.to] !== state));
  }

  function kept() {
    try {
      const found = JSON.parse(Mercator.draft(KEPT));
      return isMachine(found.machine) ? found : null;
    } catch { return null; }
  }

  /* ---- Start, text, run, save ---- */

  async function loadModules(flavour) {
    modules = await api("GET", `/modules?flavour=${encodeURIComponent(flavour)}`);
    const alone = modules.behaviours.map((one) => make("option", { value: `alone:${one.name}` }, `${one.name} alone`));
    const words = { "": "choose …", empty: "an empty diagram", rival: "the FSM to compare with" };
    at("start").replaceChildren(...Object.entries(words).map(([value, text]) => make("option", { value }, text)), ...alone);
  }

  /** The machine of a job or a design, as `kind:id`. */
  async function load(source) {
    const { job, design } = Mercator.given(source);
    const whole = await api("GET", job ? `/jobs/${encodeURIComponent(job)}/winner` : `/designs/${encodeURIComponent(design)}`);
    if (!whole.fsm.valid) throw new Error(whole.fsm.errors.join("\n"));
    return use(whole.fsm.structure);
  }

  async function use(data) {
    if (data.flavour !== modules.flavour) await loadModules(data.flavour);
    replace(ofStructure(data), { keepHistory: machine.states.length > 0 });
  }

  async function useText() {
    const text = at("text").value;
    const flavour = /flavour\s*:/.test(text) ? null : machine.flavour;
    try {
      const found = await api("POST", "/fsms/check", { fsm: text, flavour });
      at("text-problem").textContent = found.errors.join("\n");
      if (found.valid) await use(found.structure);
    } catch (error) {
      at("text-problem").textContent = error.message;
    }
  }

  const report = (error) => at("problem").replaceChildren(error.message);

  async function start(value) {
    at("problem").replaceChildren();
    try {
      if (value === "empty") replace({ flavour: machine.flavour, states: [] });
      else if (value.startsWith("alone:")) replace({ flavour: machine.flavour, states: [newState(value.slice(6))] });
      else if (value === "rival" && at("rival").value) await load(at("rival").value);
      else if (value === "rival") throw new Error("Choose first what to compare with.");
    } catch (error) {
      report(error);
    }
    at("start").value = "";
  }

  async function run(event) {
    event.preventDefault();
    if (isRunning || !machine.states.length) return;
    isRunning = at("run").disabled = true;
    const fsms = [{ name: at("name").value || "my FSM", fsm: structure() }];
    if (at("rival").value) fsms.push({ ...Mercator.given(at("rival").value), name: at("rival").selectedOptions[0].text.slice(0, 100) });
    const task = { mission: mission(), fsms };
    at("progress").textContent = `Running ${at("runs").value} instances …`;
    try {
      const data = await api("POST", "/fsms/evaluate", { ...task, runs: Number(at("runs").value), seed: Number(at("seed").value) });
      const stage = make("div", { id: "replay" });
      const instances = data.seeds.slice(0, 100).map((seed, k) => [seed, `${k + 1}: score ${data.fsms.map((one) => Mercator.number(one.scores[k])).join(" against ")}`]);
      const replay = (seed) => Mercator.replay(stage, { ...task, seed: Number(seed) });
      at("results").replaceChildren(make("section", {}, make("h2", {}, "Scores"), Mercator.evaluation(data)),
        make("section", {}, make("h2", {}, "Replay"), field("instance", "Instance", choice("instance", instances, data.seeds[0], replay)), stage));
      at("progress").textContent = "Replaying one instance …";
      await replay(data.seeds[0]);
      at("progress").textContent = "";
    } catch (error) {
      at("progress").textContent = "";
      at("results").replaceChildren(Mercator.problem(error));
    }
    isRunning = at("run").disabled = false;
  }

  async function save(event) {
    event.preventDefault();
    at("saved").textContent = "Saving …";
    try {
      const design = await api("POST", "/designs", {
        name: at("name").value.trim(), shared: at("shared")?.checked ?? false, mission: mission(), fsm: { fsm: structure() },
      });
      at("saved").replaceChildren("Saved: ", make("a", { href: `/gallery#${design.id}` }, "see it in the gallery"));
    } catch (error) {
      at("saved").replaceChildren(Mercator.problem(error));
    }
  }

  function chooseIn(id, value) {
    const list = at(id);
    if (value && [...list.options].some((one) => one.value === value)) list.value = value;
  }

  async function begin() {
    const asked = new URLSearchParams(location.search), before = kept();
    const source = ["job", "design"].filter((kind) => asked.has(kind)).map((kind) => `${kind}:${asked.get(kind)}`)[0] || "";
    const isSameAsBefore = before && before.machine && (!source || before.origin === source);
    if (isSameAsBefore) for (const id of ["mission", "rival", "runs", "seed"]) {
      if (at(id).tagName === "SELECT") chooseIn(id, before[id]);
      else if (before[id]) at(id).value = before[id];
    }
    if (asked.has("mission")) chooseIn("mission", `mission:${asked.get("mission")}`);
    await loadModules(isSameAsBefore ? before.machine.flavour : at("flavour").value);
    listen();
    at("add-state").addEventListener("click", addState);
    at("undo").addEventListener("click", undo);
    at("redo").addEventListener("click", redo);
    at("use-text").addEventListener("click", useText);
    at("text").addEventListener("paste", () => setTimeout(useText));
    at("copy-text").addEventListener("click", () => Mercator.copy(at("text")));
    at("start").addEventListener("change", () => start(at("start").value));
    at("running").addEventListener("submit", run);
    at("saving").addEventListener("submit", save);
    at("setting").addEventListener("submit", (event) => event.preventDefault());
    for (const id of ["runs", "seed", "rival"]) at(id).addEventListener("change", keep);
    at("mission").addEventListener("change", () => show());
    at("flavour").addEventListener("change", async () => {
      const flavour = at("flavour").value;
      await loadModules(flavour);
      edit(() => (machine.flavour = flavour));
    });
    matchMedia("(max-width: 720px)").addEventListener("change", () => check());
    origin = source;
    if (isSameAsBefore) {
      origin = before.origin || "";
      replace(before.machine, { keepHistory: false });
      return;
    }
    if (!source) return show();
    for (const id of ["mission", "rival"]) chooseIn(id, source);
    try {
      await load(source);
    } catch (error) {
      show();
      report(error);
    }
  }

  begin().catch(report);
})();
