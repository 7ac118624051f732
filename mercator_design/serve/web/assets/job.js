"use strict";
// The page of a job: follows its race by its events, changes it, replays its best.
(() => {
  const root = document.getElementById("job");
  const path = root.dataset.api.replace("/api/v1", "");
  const now = () => document.getElementById("now");

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
  const follow = () => {
    close();
    if (document.hidden || now().dataset.ended === "true") return;
    source = new EventSource(`${root.dataset.api}/events?after=${now().dataset.place}`);
    for (const kind of COUNTS) source.addEventListener(kind, () => soon("now"));
    for (const kind of TURNS)
      source.addEventListener(kind, () => {
        soon("now");
        soon("race");
      });
    source.addEventListener("state", async (event) => {
      const job = JSON.parse(event.data);
      if (!["succeeded", "failed", "cancelled"].includes(job.state)) return;
      close(); // the service ends the stream with it
      for (const id of ["now", "race", "files", "about", "messages"]) await Live.refresh(id);
    });
    const mine = source;
    source.addEventListener("error", () => {
      if (mine.readyState === EventSource.CLOSED && mine === source) setTimeout(again, 5000);
    });
  };
  const again = async () => {
    if (!document.hidden) await Live.refresh("now");
    follow();
  };
  document.addEventListener("visibilitychange", () => (document.hidden ? close() : (soon("race"), again())));
  document.addEventListener("changed", again);

  // ---- Changes ----
  document.getElementById("change")?.addEventListener("submit", async (event) => {
    event.preventDefault();
    const form = event.target;
    const body = { priority: Number(form.priority.value) };
    if (form.budget.value) body.budget = Number(form.budget.value);
    if (form.shared) body.shared = form.shared.checked;
    const job = await Live.act("PATCH", path, body);
    if (!job) return;
    form.budget.value = "";
    form.budget.min = job.budget + 1;
    form.budget.placeholder = job.budget;
    Live.tell("Changed.", false);
  });

  // ---- The replay of the best ----
  const watch = document.getElementById("watch");
  const shown = document.getElementById("shown");
  let showing = null; // the number of the configuration
  const named = () => {
    const { best } = document.getElementById("race").dataset;
    document.getElementById("replay").hidden = !best && showing === null;
    const isEnded = now().dataset.state === "succeeded";
    watch.hidden = !best || best === showing;
    watch.textContent = showing === null ? (isEnded ? "Replay the winner" : "Replay the best so far") : "Replay the new best";
  };
  watch.addEventListener("click", async () => {
    watch.disabled = true;
    shown.textContent = "Running it again …";
    try {
      let answer = await fetch(`/jobs/${encodeURIComponent(root.dataset.id)}/replays`);
      for (let k = 0; k < 60 && answer.status === 202; k++) {
        await new Promise((done) => setTimeout(done, 500));
        answer = await fetch(`/jobs/${encodeURIComponent(root.dataset.id)}/replays`);
      }
      const found = await answer.json();
      if (!answer.ok) throw new Error(found.errors.join("\n"));
      if (found.without) throw new Error(found.without);
      play(found);
    } catch (error) {
      shown.textContent = error.message;
    }
    watch.disabled = false;
  });
  const play = (found) => {
    const runs = document.getElementById("runs");
    const stage = document.getElementById("stage");
    const stages = [];
    const players = [];
    const show = async (chosen) => {
      tabs.forEach((tab, k) => tab.setAttribute("aria-pressed", String(k === chosen)));
      players.forEach((player, k) => k !== chosen && player.pause());
      stages.forEach((one, k) => (one.hidden = k !== chosen));
      if (!stages[chosen]) {
        stages[chosen] = stage.appendChild(Mercator.make("div", { class: "stage" }));
        const inner = stages[chosen].appendChild(document.createElement("div"));
        players[chosen] = await MercatorReplay.mount(inner, [found.replays[chosen].replay]);
      }
      window.player = players[chosen];
    };
    const tabs = found.replays.map((one, k) => Mercator.make("button", { type: "button", onclick: () => show(k) }, one.name));
    window.player?.pause();
    stage.replaceChildren();
    runs.replaceChildren(...tabs);
    shown.textContent = `Configuration ${found.best}, on instances of the race.`;
    showing = String(found.best);
    named();
    show(0);
  };

  document.addEventListener("htmx:after:swap", named);
  named();
  Live.refresh("race");
  Live.refresh("about");
  follow();
})();
