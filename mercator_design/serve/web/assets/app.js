"use strict";
// What all pages share: elements, requests to the service, and their errors as text.
const Mercator = {
  at: (id) => document.getElementById(id),

  /** An element with attributes and children; texts become text. */
  make(name, attributes = {}, ...children) {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
      else if (value !== false && value != null) element.setAttribute(key, value === true ? "" : value);
    }
    element.append(...children);
    return element;
  },

  /** The answer to a request. Throws an Error with a message for each mistake, and the status; 0 without an answer. */
  async request(method, address, body, headers = {}, signal = null) {
    const options = { method, headers: { ...headers }, signal };
    if (body !== undefined) {
      options.headers["Content-Type"] = "application/json";
      options.body = JSON.stringify(body);
    }
    const failed = (status, messages) => Object.assign(new Error(messages.join("\n")), { status });
    let answer;
    try { answer = await fetch(address, options); } catch { throw failed(0, ["The service does not answer."]); }
    if (answer.ok) return answer;
    const problem = await answer.json().catch(() => null); // a proxy may say something else
    throw failed(answer.status, problem?.errors || [`${answer.status} ${answer.statusText}`]);
  },

  /** The answer of the API as data. */
  async api(method, path, body, headers) {
    const text = await (await Mercator.request(method, `/api/v1${path}`, body, headers)).text();
    return text ? JSON.parse(text) : null;
  },

  /** Whether the user says yes. */
  confirmed(question) {
    const { make } = Mercator;
    const yes = make("button", { class: "danger", value: "yes" }, "Yes");
    const form = make("form", { method: "dialog", class: "actions" }, yes, make("button", { value: "no" }, "No"));
    const dialog = make("dialog", { "aria-label": "Are you sure?" }, make("p", {}, question), form);
    document.body.append(dialog);
    dialog.showModal();
    return new Promise((done) => {
      dialog.addEventListener("close", () => {
        dialog.remove();
        done(dialog.returnValue === "yes");
      });
    });
  },

  /** A draft of the user, which the browser keeps until the logout, and its change; null: there is none. */
  draft(name) {
    try { return localStorage.getItem(Drafts.key(name)); } catch { return null; } // private windows may refuse
  },
  keepDraft(name, text) {
    try {
      if (text === null || localStorage.getItem(Drafts.LEFT)) localStorage.removeItem(Drafts.key(name));
      else localStorage.setItem(Drafts.key(name), text);
    } catch { /* no space, or not allowed: nothing is kept */ }
  },

  /** The submission of a job by the button of a form: one job, however often the same request is sent. */
  submission(path, draft, tell) {
    const { api, at, keepDraft } = Mercator;
    let key = "";
    let keyed = "";
    let isSending = false;
    function end() {
      isSending = false;
      at("submit").removeAttribute("aria-disabled");
    }
    addEventListener("pageshow", (event) => {
      if (!event.persisted) return; // the browser has brought the page back: what is submitted now is another job
      keyed = "";
      end();
      tell("", "problem");
    });
    return {
      isSending: () => isSending,
      async send(request, message) {
        isSending = true;
        at("submit").setAttribute("aria-disabled", "true");
        tell(message, "faint");
        try {
          const body = await request();
          if (JSON.stringify(body) !== keyed) {
            keyed = JSON.stringify(body);
            key = [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
          }
          const { job } = await api("POST", path, body, { "Idempotency-Key": key });
          keepDraft(draft, null);
          location.assign(`/jobs/${encodeURIComponent(job.id)}`);
        } catch (error) {
          tell(error.message, "problem");
          at("notice").focus();
          end();
        }
      },
    };
  },

  /** An error, as an element. */
  problem: (error) => Mercator.make("p", { class: "problem", role: "alert" }, error.message),
};

// Who logs out, or uses a browser after another user, leaves and finds no draft there.
const Drafts = {
  LEFT: "mercator/left", // as long as nobody has logged in after a logout: pages that are still open keep nothing
  user: document.querySelector(".who")?.textContent ?? null,
  key: (name) => `mercator/${Drafts.user}/${name}`,
  clear(isKept) {
    for (const key of Object.keys(localStorage)) if (key.startsWith("mercator/") && !isKept(key)) localStorage.removeItem(key);
  },
  begin() {
    try {
      if (Drafts.user !== null) Drafts.clear((key) => key.startsWith(Drafts.key("")));
      else if (localStorage.getItem(Drafts.LEFT)) Drafts.clear((key) => key === Drafts.LEFT);
    } catch { /* there is no storage */ }
  },
  leave() {
    try {
      Drafts.clear(() => false);
      localStorage.setItem(Drafts.LEFT, "1");
    } catch { /* there is no storage */ }
  },
};
Drafts.begin();
document.addEventListener("submit", (event) => event.target.matches("form[action='/logout']") && Drafts.leave());
