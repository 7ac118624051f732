"use strict";
// The page of a new job: the editor of its mission, what the service says of it, and its submission.
(() => {
  const { api, at, make } = Mercator;
  const form = at("new");
  const initial = at("text").value;
  const place = `new/${form.dataset.start}`;
  const fields = [...form.querySelectorAll("[name]")];
  const startSettings = settings();

  // What is typed survives a reload.
  function settings() {
    return Object.fromEntries(fields.map((field) => [field.name, field.value]));
  }
  function draft() {
    try { return JSON.parse(Mercator.draft(place)) || {}; } catch { return {}; }
  }
  let isKept = true;
  function keep() {
    const text = mission();
    isKept = true;
    const isChanged = text !== initial || fields.some((field) => field.value !== startSettings[field.name]);
    Mercator.keepDraft(place, isChanged ? JSON.stringify({ text, settings: settings() }) : null);
    at("back").disabled = text === initial;
  }

  // Requests: one of a kind at a time; of several inputs the last is asked for, and answers to older ones are dropped.
  function latest(ask, show) {
    let isRunning = false;
    let wanted = null;
    const run = async () => {
      isRunning = true;
      while (wanted) {
        const [input] = wanted;
        wanted = null;
        let answer = null;
        let problem = null;
        try { answer = await ask(input); } catch (error) { problem = error; }
        if (!wanted) show(answer, problem, input);
      }
      isRunning = false;
    };
    return { ask(input) { wanted = [input]; if (!isRunning) run(); }, get isBusy() { return isRunning; } };
  }
  function later(milliseconds, action) {
    let timer = 0;
    return () => { clearTimeout(timer); timer = setTimeout(action, milliseconds); };
  }

  // The editor.
  const { EditorView, EditorState, Compartment, tags: t } = CodeMirror;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const theme = new Compartment();
  const look = () => EditorView.theme({
    ".cm-content": { caretColor: "var(--ink)" },
    ".cm-cursor": { borderLeftColor: "var(--ink)" },
    ".cm-gutters": { backgroundColor: "var(--panel)", color: "var(--faint)", borderRight: "1px solid var(--line)" },
    ".cm-activeLine": { backgroundColor: "color-mix(in srgb, var(--accent) 8%, transparent)" },
    ".cm-activeLineGutter": { backgroundColor: "color-mix(in srgb, var(--accent) 18%, transparent)" },
    ".cm-tooltip": { backgroundColor: "var(--panel)", color: "var(--ink)", border: "1px solid var(--line)" },
    ".cm-tooltip-autocomplete > ul": { maxWidth: "min(560px, 92vw)" },
    ".cm-tooltip-autocomplete > ul > li[aria-selected]": { backgroundColor: "var(--accent)", color: "var(--page)" },
    ".cm-completionDetail": { fontStyle: "normal", opacity: "0.75", fontSize: "12px" },
    ".cm-completionInfo": { fontFamily: "system-ui, sans-serif" },
    ".cm-panels": { backgroundColor: "var(--panel)", color: "var(--ink)" },
    ".cm-tooltip-lint": { fontFamily: "system-ui, sans-serif", maxWidth: "min(520px, 90vw)" },
  }, { dark: dark.matches });
  const colours = CodeMirror.HighlightStyle.define([
    { tag: [t.propertyName, t.definition(t.propertyName)], color: "var(--key)" },
    { tag: [t.string, t.special(t.string)], color: "var(--string)" },
    { tag: [t.number, t.bool, t.keyword], color: "var(--number)" },
    { tag: t.comment, color: "var(--faint)", fontStyle: "italic" },
    { tag: t.invalid, color: "var(--bad)" },
  ]);
  const characters = (text) => Array.from(text).length;

  async function complete(context) {
    if (!context.explicit && !context.matchBefore(/\w+/)) return null;
    const line = context.state.doc.lineAt(context.pos);
    const column = characters(line.text.slice(0, context.pos - line.from)) + 1;
    let found;
    try {
      found = await api("POST", "/missions/complete", { text: context.state.doc.toString(), line: line.number, column });
    } catch { return null; }
    if (context.aborted || !found.options.length) return null;
    const start = Array.from(line.text).slice(0, found.column - 1).join("").length;
    const indent = `\n${" ".repeat(start)}`;
    return {
      from: line.from + start,
      validFor: /^[\w .-]*$/,
      options: found.options.map((one, number) => ({
        label: one.label,
        detail: one.detail,
        info: one.info || undefined,
        type: one.kind === "key" ? "property" : "constant",
        boost: Math.max(-99, 50 - number),
        apply(view, _, from, to) {
          const isKept = view.state.sliceDoc(to, to + 1) === ":";
          const insert = isKept ? one.label : one.insert.replaceAll("\n", indent);
          view.dispatch({
            changes: { from, to, insert },
            selection: { anchor: from + insert.length },
            userEvent: "input.complete",
            annotations: CodeMirror.pickedCompletion.of(one),
          });
          if (insert.endsWith(" ")) setTimeout(() => CodeMirror.startCompletion(view));
        },
      })),
    };
  }

  const changed = later(300, () => { keep(); check(); });
  const view = new EditorView({
    parent: at("editor"),
    state: EditorState.create({
      doc: draft().text ?? initial,
      extensions: [
        CodeMirror.lineNumbers(), CodeMirror.lintGutter(), CodeMirror.highlightActiveLine(),
        CodeMirror.highlightActiveLineGutter(), CodeMirror.drawSelection(), CodeMirror.history(),
        CodeMirror.indentOnInput(), CodeMirror.bracketMatching(), CodeMirror.highlightSelectionMatches(),
        CodeMirror.yaml(), CodeMirror.syntaxHighlighting(colours), theme.of(look()), EditorView.lineWrapping,
        CodeMirror.autocompletion({ override: [complete], icons: false }),
        CodeMirror.keymap.of([
          ...CodeMirror.completionKeymap, ...CodeMirror.defaultKeymap, ...CodeMirror.historyKeymap,
          ...CodeMirror.lintKeymap, ...CodeMirror.searchKeymap,
        ]),
        EditorView.contentAttributes.of({ tabindex: "0", "aria-labelledby": "text-label", "aria-describedby": "keys" }),
        EditorView.updateListener.of((update) => { if (update.docChanged) { state = null; isKept = false; changed(); } }),
      ],
    }),
  });
  dark.addEventListener("change", () => view.dispatch({ effects: theme.reconfigure(look()) }));
  at("text").hidden = true;
  at("text-label").addEventListener("click", () => view.focus());

  function mission() {
    return view.state.doc.toString();
  }
  function given() {
    const text = mission();
    return form.dataset.shipped && text === initial ? { mission: form.dataset.shipped } : { mission_text: text };
  }
  function replace(text) {
    view.dispatch({ changes: { from: 0, to: view.state.doc.length, insert: text }, userEvent: "input" });
  }

  // Mistakes and warnings.
  let state = null; // the last check of the text as it is now
  const checking = latest(
    (body) => api("POST", "/missions/check", body),
    (review, problem) => {
      if (problem) {
        state = null;
        write("summary", problem.message, "bad");
        return;
      }
      state = review;
      show(review);
      if (review.facts) {
        draw();
        estimate();
      } else {
        at("picture").classList.add("old");
        at("caption").textContent = at("picture").hidden ? "No picture: the mission has mistakes." : "As it was before the mistakes.";
        write("estimate", "The time can be estimated when the mission has no mistakes.");
      }
    });
  function check() {
    write("notice", "");
    checking.ask({ ...given(), flavour: at("flavour").value });
  }
  function write(name, text, kind = "") {
    at(name).textContent = text;
    at(name).className = name === "summary" ? `summary ${kind}` : kind;
  }
  function show(review) {
    const found = [
      ...review.errors.map((one) => ({ ...one, severity: "error" })),
      ...review.warnings.map((one) => ({ ...one, severity: "warning" })),
    ];
    const marks = found.filter((one) => one.line !== null).map((one) => ({ ...range(one), severity: one.severity, message: one.message }));
    view.dispatch(CodeMirror.setDiagnostics(view.state, marks));
    at("findings").replaceChildren(...found.map(item));
    const count = (n, what) => `${n} ${what}${n === 1 ? "" : "s"}`;
    const warnings = review.warnings.length ? `, ${count(review.warnings.length, "warning")}` : "";
    if (review.errors.length) write("summary", `${count(review.errors.length, "mistake")}${warnings}`, "bad");
    else write("summary", `No mistakes${warnings}`, "good");
    at("facts").replaceChildren(...(review.facts ? facts(review.facts) : []));
  }
  function item(one) {
    const words = one.path ? `${one.path}: ${one.message}` : one.message;
    if (one.line === null) return make("li", { class: one.severity }, words);
    const go = () => {
      const { from } = range(one);
      view.dispatch({ selection: { anchor: from }, effects: EditorView.scrollIntoView(from, { y: "center" }) });
      view.focus();
    };
    return make("li", { class: one.severity }, make("button", { type: "button", onclick: go }, `Line ${one.line}`), words);
  }
  function range(one) {
    const { doc } = view.state;
    const offset = (number, column) => {
      const line = doc.line(Math.max(1, Math.min(number, doc.lines)));
      return line.from + Math.min(line.length, Array.from(line.text).slice(0, column - 1).join("").length);
    };
    const line = doc.line(Math.max(1, Math.min(one.line, doc.lines)));
    if (one.column === null) return { from: line.from + line.text.search(/\S|$/), to: line.to };
    const from = offset(one.line, one.column);
    const to = offset(one.end_line, one.end_column);
    return from < to ? { from, to } : { from: Math.max(line.from, Math.min(from, line.to - 1)), to: line.to };
  }
  function facts(one) {
    const rows = {
      Name: one.name,
      Robots: `${one.robots}, ${one.robot_model}`,
      Duration: `${one.duration} s, ${Math.round(one.duration / one.control_period)} control cycles`,
      Objective: `${one.direction} ${one.objective}`,
      "Never fires": one.never_fires.join(", ") || null,
      Digest: one.digest,
    };
    return Object.entries(rows).filter(([, value]) => value !== null)
      .flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]);
  }

  // The picture.
  const drawing = latest(
    async (body) => {
      const answer = await Mercator.request("POST", "/api/v1/missions/preview", { ...body, kind: "png" });
      const reader = new FileReader();
      reader.readAsDataURL(await answer.blob());
      return new Promise((done, failed) => { reader.onload = () => done(reader.result); reader.onerror = failed; });
    },
    (picture, problem) => {
      at("picture").classList.toggle("old", problem !== null);
      if (problem) {
        at("caption").textContent = `No picture: ${problem.message}`;
        return;
      }
      at("picture").src = picture;
      at("picture").hidden = false;
      at("picture").alt = state?.facts ? `The mission ${state.facts.name} from above.` : "The mission from above.";
      at("caption").textContent = "From above, with one start of the robots.";
    });
  function draw() {
    if (at("picture").hidden || at("picture").classList.contains("old")) at("caption").textContent = "Drawing the mission …";
    drawing.ask(given());
  }

  // How long it will take.
  const estimating = latest(
    (body) => api("POST", "/missions/estimate", body),
    (found, problem) => {
      if (problem) write("estimate", problem.message, "problem");
      else write("estimate", sentence(found));
    });
  const estimate = later(500, () => { if (state?.facts && !state.errors.length) estimating.ask(request()); });
  function time(seconds) {
    if (seconds < 100) return `${Math.max(1, Math.round(seconds))} s`;
    if (seconds < 6000) return `${Math.round(seconds / 60)} min`;
    return seconds < 172800 ? `${(seconds / 3600).toPrecision(2)} h` : `${Math.round(seconds / 86400)} days`;
  }
  function sentence({ cost, cores, wait }) {
    const [low, high] = cost.seconds.map(time);
    const [less, more] = cost.core_seconds.map(time);
    const milliseconds = Number((1000 * cost.experiment).toPrecision(2));
    const before = wait.running + wait.queued
      ? `Before it: ${wait.running} running, ${wait.queued} waiting; ${wait.seconds ? `it begins in about ${time(wait.seconds)}` : "it begins at once"}.`
      : "No job is before it.";
    return `About ${low} to ${high} if ${cores === 1 ? "1 core is" : `${cores} cores are`} free. Computing time: ${less} to ${more}; ` +
      `an experiment takes ${milliseconds} ms (measured on ${cost.timed}). ${before}`;
  }
  function request() {
    const numbers = ["budget", "seed", "test_runs", "priority"];
    const values = fields.map((field) => [field.name, numbers.includes(field.name) ? Number(field.value) : field.value]);
    return { ...given(), ...Object.fromEntries(values) };
  }

  const submission = Mercator.submission("/jobs", place, (text, kind) => write("notice", text, kind));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    if (submission.isSending()) return;
    const wrong = fields.find((field) => !field.checkValidity());
    if (wrong) {
      write("notice", `${wrong.labels[0].textContent}: ${wrong.validationMessage}`, "problem");
      wrong.focus();
      return;
    }
    submission.send(request, "Submitting …");
  });
  addEventListener("pagehide", () => { if (!isKept && !submission.isSending()) keep(); }); // what was typed just now

  // Settings.
  for (const [name, value] of Object.entries(draft().settings || {})) {
    const field = fields.find((one) => one.name === name);
    if (field) field.value = value;
  }
  for (const field of fields) field.addEventListener("input", () => { keep(); write("notice", ""); if (field.name === "flavour") check(); else estimate(); });
  for (const button of form.querySelectorAll("[data-budget]")) {
    button.addEventListener("click", () => { at("budget").value = button.dataset.budget; keep(); estimate(); });
  }
  at("back").addEventListener("click", () => {
    replace(initial);
    at("kept").textContent = "This is the original text; undo brings yours back.";
    view.focus();
  });
  if (mission() !== initial) at("kept").textContent = "Your earlier text was restored.";
  keep();
  check();
})();
