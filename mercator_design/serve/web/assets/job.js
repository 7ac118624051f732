"use strict";
// The page of a job: follows its race by its events, changes it, replays its best.
(() => {
  const { api, at, make } = Mercator;
  const root = at("job");
  const path = root.dataset.api.replace("/api/v1", "");

  // ---- Following ----
  const EVERY = { now: 1000, race: 2000 }; // milliseconds between two refreshes of a part
  const due = {};
  const last = {};
  const soon = (id) => {
    if (due[id]) return;
    const wait = Math.max(0, (last[id] || 0) + EVERY[id] - Date.now());
    due[id] = setTimeout(async () => {
      last[id] = Date.now();
      await Live.refresh(id);
      due[id] = null;
    }, wait);
  };
  const COUNTS = ["experiment", "ahead", "configuration", "revised"];
  const TURNS = ["session", "stop", "iteration", "test", "extend", "end", "state"];
  let source = null;
  const close = () => {
    source?.close();
    source = null;
  };
  const POLLED = "Too many pages follow races now, so this one is renewed every 5 seconds. Close some to see it live.";
  const follow = () => {
    close();
    if (document.hidden || Live.isLeaving || at("now").dataset.ended === "true") return;
    source = new EventSource(`${root.dataset.api}/events?after=${at("now").dataset.place}`);
    for (const kind of COUNTS) source.addEventListener(kind, () => soon("now"));
    for (const kind of TURNS)
      source.addEventListener(kind, () => {
        soon("now");
        soon("race");
      });
    source.addEventListener("state", async (event) => {
      const job = JSON.parse(event.data);
      if (!["finished", "failed", "cancelled"].includes(job.state)) return;
      close(); // the service ends the stream with it
      for (const id of ["now", "race", "files", "about", "messages"]) await Live.refresh(id);
    });
    const mine = source;
    source.addEventListener("open", () => at("notice").textContent === POLLED && Live.report(""));
    source.addEventListener("error", () => {
      if (mine.readyState !== EventSource.CLOSED || mine !== source) return;
      Live.report(POLLED, false); // what else may be wrong, the next request says
      soon("race");
      setTimeout(again, 5000);
    });
  };
  const again = async () => {
    if (!document.hidden) await Live.refresh("now");
    follow();
  };
  document.addEventListener("visibilitychange", () => (document.hidden ? close() : (soon("race"), again())));
  document.addEventListener("changed", again);
  document.addEventListener("leaving", close);

  // ---- Changes ----
  at("change")?.addEventListener("submit", async (event) => {
    event.preventDefault();
    const form = event.target;
    const body = {}; // only what was changed here: the rest may have been changed elsewhere since
    if (form.priority.value !== form.priority.defaultValue) body.priority = Number(form.priority.value);
    if (form.budget?.value) body.budget = Number(form.budget.value);
    if (form.shared && form.shared.checked !== form.shared.defaultChecked) body.shared = form.shared.checked;
    const job = await Live.act("PATCH", path, body);
    if (!job) return;
    form.priority.value = form.priority.defaultValue = job.priority;
    if (form.shared) form.shared.checked = form.shared.defaultChecked = job.shared;
    if (form.budget) {
      form.budget.value = "";
      form.budget.min = job.budget + 1;
      form.budget.placeholder = job.budget;
    }
    Live.report("Changed.", false);
  });

  // ---- The replay of the best ----
  const [watch, shown, stage] = ["watch", "shown", "stage"].map(at);
  let showing = null; // the number of the configuration
  let players = []; // of its runs
  const named = () => {
    const { best } = at("race").dataset;
    at("replay").hidden = !best && showing === null;
    const isEnded = at("now").dataset.state === "finished";
    watch.hidden = !best || best === showing;
    watch.textContent = showing === null ? (isEnded ? "Replay the winner" : "Replay the best so far") : "Replay the new best";
  };
  watch.addEventListener("click", async () => {
    const { best, runs } = at("race").dataset;
    const found = JSON.parse(runs);
    const stages = [];
    players.forEach((player) => player.pause());
    const own = (players = []);
    const show = async (chosen) => {
      tabs.forEach((tab, k) => tab.setAttribute("aria-pressed", String(k === chosen)));
      own.forEach((player, k) => k !== chosen && player.pause());
      stages.forEach((one, k) => (one.hidden = k !== chosen));
      if (stages[chosen]) return;
      const { seed, score } = found[chosen];
      const place = (stages[chosen] = stage.appendChild(make("div", { class: "stage" })));
      shown.textContent = "Running it again …";
      try {
        const [replay] = await api("GET", `${path}/replay?configuration=${best}&seed=${seed}`);
        if (replay.header.score !== score)
          throw new Error("It has another score now: the simulator has another version than that of the race.");
        own[chosen] = await MercatorReplay.mount(place.appendChild(make("div")), [replay]);
        shown.textContent = `Configuration ${best}, on instances of the race.`;
      } catch (error) {
        delete stages[chosen];
        place.remove();
        shown.textContent = error.message;
      }
    };
    const tabs = found.map(({ label }, k) => make("button", { type: "button", onclick: () => show(k) }, label));
    stage.replaceChildren();
    at("runs").replaceChildren(...tabs);
    watch.disabled = true;
    await show(0);
    watch.disabled = false;
    if (!own[0]) return;
    showing = best;
    named();
  });

  document.addEventListener("htmx:after:swap", named);
  named();
  Live.refresh("race");
  Live.refresh("about");
  follow();
})();
