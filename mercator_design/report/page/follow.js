"use strict";
const live = document.getElementById("live");
const ask = async () => {
  let told;
  try {
    told = await (await fetch("live", { cache: "no-store" })).json();
  } catch {
    document.getElementById("state").textContent = "mdesign report --follow has ended";
    return;
  }
  if (told.ended) return location.reload();
  live.innerHTML = told.html;
  setTimeout(ask, told.seconds * 1000);
};
setTimeout(ask, 1000);
