"use strict";
// The page of a new study: its files and its submission.
(() => {
  const { api, at, make } = Mercator;
  const initial = at("text").value;
  const place = `study/${at("new").dataset.shipped}`;
  at("text").value = Mercator.draft(place) ?? initial;
  at("text").addEventListener("input", () => {
    Mercator.keepDraft(place, at("text").value === initial ? null : at("text").value);
    at("notice").textContent = "";
  });
  at("files").addEventListener("change", () => {
    at("notice").textContent = "";
    at("chosen").replaceChildren(...[...at("files").files].map((file) => make("li", {}, `${file.name}, ${file.size} bytes`)));
  });

  // The same request with the same key is one job, however often it is sent.
  let key = "";
  let keyed = "";
  let isSending = false;
  function tell(text, kind) {
    at("notice").textContent = text;
    at("notice").className = kind;
  }
  async function body() {
    const decoder = new TextDecoder("utf-8", { fatal: true });
    const files = {};
    for (const file of at("files").files) {
      try { files[file.name] = decoder.decode(await file.arrayBuffer()); } catch { throw new Error(`${file.name}: expected UTF-8 text`); }
    }
    const text = at("text").value;
    const isShipped = text === initial && !Object.keys(files).length;
    return { ...(isShipped ? { study: at("new").dataset.shipped } : { study_text: text, files }), priority: Number(at("priority").value) };
  }
  at("new").addEventListener("submit", async (event) => {
    event.preventDefault();
    if (isSending) return;
    if (!at("priority").checkValidity()) {
      tell(`Priority: ${at("priority").validationMessage}`, "problem");
      at("priority").focus();
      return;
    }
    isSending = true;
    at("submit").setAttribute("aria-disabled", "true");
    tell("Submitting … The service reads the study and its missions first.", "faint");
    try {
      const sent = await body();
      if (JSON.stringify(sent) !== keyed) {
        keyed = JSON.stringify(sent);
        key = [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
      }
      const { job } = await api("POST", "/studies", sent, { "Idempotency-Key": key });
      Mercator.keepDraft(place, null);
      location.assign(`/jobs/${encodeURIComponent(job.id)}`);
    } catch (error) {
      tell(error.message, "problem");
      at("notice").focus();
      isSending = false;
      at("submit").removeAttribute("aria-disabled");
    }
  });
  addEventListener("pageshow", (event) => {
    if (!event.persisted) return; // the browser has brought the page back: what is submitted now is another job
    keyed = "";
    isSending = false;
    at("submit").removeAttribute("aria-disabled");
    tell("", "problem");
  });
})();
