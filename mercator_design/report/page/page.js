"use strict";
document.addEventListener("click", async (event) => {
  const button = event.target.closest("[data-copy]");
  if (!button) return;
  const text = button.parentElement.querySelector("pre");
  try {
    await navigator.clipboard.writeText(text.textContent);
  } catch {
    getSelection().selectAllChildren(text);
    document.execCommand("copy");
  }
  button.textContent = "Copied";
  setTimeout(() => (button.textContent = "Copy"), 1500);
});
const data = document.getElementById("sources");
if (data) {
  const sources = JSON.parse(data.textContent);
  const stages = sources.map(() => null);
  const tabs = [...document.querySelectorAll("[data-replay]")];
  const show = async (chosen) => {
    for (const [k, tab] of tabs.entries()) tab.setAttribute("aria-selected", String(k === chosen));
    for (const stage of stages) if (stage) stage.hidden = true;
    if (!stages[chosen]) {
      stages[chosen] = document.createElement("div");
      stages[chosen].className = "stage";
      const root = stages[chosen].appendChild(document.createElement("div"));
      document.getElementById("replay").append(stages[chosen]);
      window.player = await MercatorReplay.mount(root, [sources[chosen]]);
    }
    stages[chosen].hidden = false;
  };
  for (const [k, tab] of tabs.entries()) tab.addEventListener("click", () => show(k));
  show(0);
}
