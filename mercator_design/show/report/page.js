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
// Parts that are wider than the screen say that they scroll, also those that are shown later.
const mark = () => {
  for (const part of document.querySelectorAll(".scroll")) part.classList.toggle("is-cut", part.scrollWidth > part.clientWidth + 1);
};
const soon = () => requestAnimationFrame(mark);
mark();
new ResizeObserver(soon).observe(document.documentElement);
new MutationObserver(soon).observe(document.documentElement, { childList: true, subtree: true });
document.addEventListener("toggle", soon, true);
const data = document.getElementById("sources");
if (data) {
  const sources = JSON.parse(data.textContent);
  const stages = [];
  const players = [];
  const tabs = [...document.querySelectorAll("[data-replay]")];
  const show = async (chosen) => {
    const isNew = !stages[chosen];
    if (isNew) {
      stages[chosen] = document.getElementById("replay").appendChild(document.createElement("div"));
      stages[chosen].className = "stage";
    }
    tabs.forEach((tab, k) => tab.setAttribute("aria-pressed", String(k === chosen)));
    stages.forEach((stage, k) => (stage.hidden = k !== chosen));
    players.forEach((player, k) => k !== chosen && player.pause());
    if (isNew) {
      const root = stages[chosen].appendChild(document.createElement("div"));
      players[chosen] = await MercatorReplay.mount(root, [sources[chosen]]);
    }
    window.player = players[chosen];
  };
  tabs.forEach((tab, k) => tab.addEventListener("click", () => show(k)));
  show(0);
}
