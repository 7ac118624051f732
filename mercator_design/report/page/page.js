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
  const stages = [];
  const tabs = [...document.querySelectorAll("[data-replay]")];
  const show = async (chosen) => {
    const isNew = !stages[chosen];
    if (isNew) {
      stages[chosen] = document.getElementById("replay").appendChild(document.createElement("div"));
      stages[chosen].className = "stage";
    }
    tabs.forEach((tab, k) => tab.setAttribute("aria-selected", String(k === chosen)));
    stages.forEach((stage, k) => (stage.hidden = k !== chosen));
    if (isNew) {
      const root = stages[chosen].appendChild(document.createElement("div"));
      window.player = await MercatorReplay.mount(root, [sources[chosen]]);
    }
  };
  tabs.forEach((tab, k) => tab.addEventListener("click", () => show(k)));
  show(0);
}
