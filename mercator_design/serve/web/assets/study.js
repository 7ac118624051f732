"use strict";
// The page of a new study: its files and its submission.
(() => {
  const { at, make } = Mercator;
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
    const { shipped } = at("new").dataset;
    const isShipped = text === initial && !Object.keys(files).length;
    return { ...(isShipped ? { study: shipped } : { study_text: text, study_name: shipped, files }), priority: Number(at("priority").value) };
  }
  const submission = Mercator.submission("/studies", place, tell);
  at("new").addEventListener("submit", (event) => {
    event.preventDefault();
    if (submission.isSending()) return;
    if (!at("priority").checkValidity()) {
      tell(`Priority: ${at("priority").validationMessage}`, "problem");
      at("priority").focus();
      return;
    }
    submission.send(body, "Submitting … The service reads the study and its missions first.");
  });
})();
