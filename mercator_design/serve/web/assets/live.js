"use strict";
// Parts of a page that are asked for again, each by its id: <div id data-live="ADDRESS" data-seconds="3">. They are
// changed where they differ, so focus, open details and the place in the page stay. Hidden tabs do not ask.
const Live = (() => {
  const asked = new Map(); // by id: when, and whether an answer is awaited
  const { at } = Mercator;
  const notice = at("notice");
  let leaving = new AbortController(); // aborted when what the page shows is deleted: then nothing is asked for

  const report = (text, isBad = true, isLost = false) => {
    if (!notice) return;
    notice.toggleAttribute("data-lost", isLost);
    if (notice.textContent === text) return;
    notice.className = isBad ? "problem" : "faint";
    notice.textContent = text;
  };

  /** Ask for a part once more. */
  const refresh = async (id) => {
    const element = at(id);
    const state = asked.get(id) || {};
    const { signal } = leaving;
    if (signal.aborted || !element || !element.dataset.live) return;
    if (state.isAwaited) {
      state.again = true;
      return;
    }
    asked.set(id, Object.assign(state, { isAwaited: true, again: false, time: Date.now() }));
    const address = element.dataset.live;
    const have = element.dataset.have ? `?have=${element.dataset.have}` : "";
    let wait = null;
    try {
      const answer = await Mercator.request("GET", address + have, undefined, { "HX-Request": "true" }, signal);
      if (notice && notice.hasAttribute("data-lost")) report("");
      if (answer.status !== 204) {
        const text = await answer.text();
        if (element.dataset.live === address)
          await htmx.swap({ sourceElement: element, target: element, text, swap: "outerMorph" });
      }
      if (answer.headers.has("X-Again")) wait = 2500;
    } catch (error) {
      if (error.status === 401) location.reload();
      else if (error.status === 404) report("This is gone, or no longer shown to you.");
      else if (error.status) report(error.message);
      else if (!signal.aborted) report("The service does not answer; this page tries again.", true, true);
    }
    state.isAwaited = false;
    if (wait === null && state.again) wait = 500;
    if (wait !== null) setTimeout(refresh, wait, id);
  };

  const look = () => {
    if (document.hidden) return;
    for (const element of document.querySelectorAll("[data-live][data-seconds]")) {
      const { time = started } = asked.get(element.id) || {};
      if (Date.now() - time >= 1000 * element.dataset.seconds) refresh(element.id);
    }
  };
  const started = Date.now();
  setInterval(look, 500);
  document.addEventListener("visibilitychange", () => {
    if (!document.hidden) for (const element of document.querySelectorAll("[data-live][data-seconds]")) refresh(element.id);
  });

  /** Send a change, and show what it has changed. */
  const act = async (method, path, body) => {
    let answer = null;
    if (method === "DELETE") {
      leaving.abort();
      document.dispatchEvent(new CustomEvent("leaving"));
    }
    try {
      answer = (await Mercator.api(method, path, body)) ?? true;
      report("");
    } catch (error) {
      report(error.message);
    }
    if (method === "DELETE" && answer !== null) return answer;
    if (leaving.signal.aborted) leaving = new AbortController();
    document.dispatchEvent(new CustomEvent("changed"));
    return answer;
  };

  document.addEventListener("click", async (event) => {
    const button = event.target.closest("[data-do]");
    if (!button || button.ariaBusy === "true") return;
    const place = button.closest(".actions, tr");
    if (button.dataset.confirm && !(await Mercator.confirmed(button.dataset.confirm))) return;
    button.ariaBusy = "true";
    const [method, path] = button.dataset.do.split(" ");
    const isDone = await act(method, path);
    button.ariaBusy = null;
    if (isDone && method === "DELETE") location.assign("/");
    const list = at("jobs");
    if (list) await refresh("jobs");
    if (document.activeElement === document.body && place) place.querySelector("button, a")?.focus();
  });

  // The address of the page is that of the list as it is shown.
  document.addEventListener("htmx:after:swap", () => {
    const query = at("jobs")?.dataset.live.replace(/^[^?]*\??/, "");
    if (query !== undefined && query !== location.search.slice(1)) history.replaceState(null, "", query ? `/?${query}` : "/");
  });

  return {
    refresh,
    report,
    act,
    get isLeaving() {
      return leaving.signal.aborted;
    },
  };
})();
