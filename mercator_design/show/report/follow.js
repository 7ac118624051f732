"use strict";
const live = document.getElementById("live");
const ask = async () => {
  let news;
  try {
    news = await (await fetch("live", { cache: "no-store" })).json();
  } catch {
    document.getElementById("state").textContent = "mdesign report --follow has ended";
    return;
  }
  if (news.ended) return location.reload();
  const open = [...live.querySelectorAll("details[open] > summary")].map((summary) => summary.textContent);
  live.innerHTML = news.html;
  for (const summary of live.querySelectorAll("summary")) summary.parentElement.open = open.includes(summary.textContent);
  setTimeout(ask, news.seconds * 1000);
};
setTimeout(ask, 1000);
