"use strict";
// What the pages on FSMs share: evaluations as chart, words and tables; replays in the viewer; choices of designs.
Object.assign(Mercator, {
  /** A number as charts show it. */
  number: (value) => String(Number(value.toPrecision(4))),

  /** A p-value in words. */
  pText: (p) => (p < 0.001 ? "p < 0.001" : `p = ${Number(p.toPrecision(2))}`),

  /** An SVG of the service as an element. */
  svg(text) {
    const parsed = new DOMParser().parseFromString(text, "image/svg+xml");
    return document.importNode(parsed.documentElement, true);
  },

  /** A choice such as "job:ID" as the keys of a request. */
  given(choice) {
    const at = choice.indexOf(":");
    return { [choice.slice(0, at)]: choice.slice(at + 1) };
  },

  /** What an evaluation says of the first design, in sentences. */
  verdicts({ fsms, pairs, direction, runs }) {
    const sign = direction === "maximise" ? 1 : -1;
    return pairs.filter((pair) => pair.first === fsms[0].name).map((pair) => {
      const how = pair.p_value >= 0.05 ? "not distinguishable from"
        : sign * pair.mean_difference > 0 ? "significantly better than" : "significantly worse than";
      const [low, high] = pair.confidence_interval.map(Mercator.number);
      return `${pair.first} is ${how} ${pair.second}: the difference of their mean scores is ${Mercator.number(pair.mean_difference)} ` +
        `(95 % interval ${low} to ${high}; ${Mercator.pText(pair.p_value)}, paired t-test on ${runs} instances).`;
    });
  },

  /** A table of texts. */
  table(head, rows, name) {
    const cells = (kind, row) => Mercator.make("tr", {}, ...row.map((cell) => Mercator.make(kind, {}, cell)));
    const body = Mercator.make("tbody", {}, ...rows.map((row) => cells("td", row)));
    const whole = Mercator.make("table", { "data-table": name }, Mercator.make("thead", {}, cells("th", head)), body);
    return Mercator.make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": name }, whole);
  },

  /** An evaluation: the verdict, box plots, figures, pairs. */
  evaluation(data) {
    const { make, number, table, pText } = Mercator;
    const interval = (ends) => (ends ? `${number(ends[0])} to ${number(ends[1])}` : "");
    const rows = data.fsms.map((one) => [
      one.name, number(one.mean), interval(one.confidence_interval),
      one.standard_deviation === null ? "" : number(one.standard_deviation), one.quartiles.map(number).join(", "),
    ]);
    const pairs = data.pairs.map((pair) => [
      `${pair.first} − ${pair.second}`, number(pair.mean_difference), interval(pair.confidence_interval), pText(pair.p_value),
    ]);
    const about = `${data.mission}: ${data.robots} robots, ${data.duration} s, ${data.runs} fresh instances of seed ${data.seed}; ${data.direction} the score. ` +
      "Boxes are quartiles, large dots means with their 95 % intervals" + (pairs.length ? "; p as in the table, against the best mean." : ".");
    return make("div", { class: "evaluation" },
      ...Mercator.verdicts(data).map((words) => make("p", { class: "verdict" }, words)),
      make("figure", {}, make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Chart of the scores" }, Mercator.svg(data.chart)), make("figcaption", {}, about)),
      table(["design", "mean", "95 % interval", "standard deviation", "quartiles"], rows, "Scores"),
      ...(pairs.length ? [
        table(["pair", "difference", "95 % interval", pairs.length > 1 ? "p (Holm)" : "p"], pairs, "Paired t-tests"),
      ] : []));
  },

  /** Run FSMs on an instance, and show the replays in an element, side by side; of several requests, the last counts. */
  async replay(element, task) {
    element.asked = task;
    try {
      const sources = await Mercator.api("POST", "/fsms/replay", task);
      if (element.asked !== task) return;
      if (element.player) element.player.pause();
      const root = Mercator.make("div");
      element.replaceChildren(Mercator.make("div", { class: "stage" }, root));
      element.player = await MercatorReplay.mount(root, sources);
    } catch (error) {
      if (element.asked === task) element.replaceChildren(Mercator.problem(error));
    }
  },

  /** Copy a text; a page without TLS may not use the clipboard, so there the text is selected and copied. */
  async copy(area) {
    if (navigator.clipboard && window.isSecureContext) return navigator.clipboard.writeText(area.value);
    area.select();
    document.execCommand("copy");
  },
});
