"use strict";
// The gallery: diagrams are drawn when their cards come into view.
(() => {
  const { api, at, make } = Mercator;
  const cards = [...document.querySelectorAll(".card")];
  const pathOf = ({ dataset: { kind, id } }) => `/${kind}s/${encodeURIComponent(id)}`;
  const viewer = at("viewer"), stage = at("replay");

  async function draw(card) {
    const place = card.querySelector(".diagram");
    try {
      const found = await api("GET", card.dataset.kind === "job" ? `${pathOf(card)}/winner` : pathOf(card));
      place.replaceChildren(found.fsm.valid ? Mercator.svg(found.fsm.diagram) : make("p", { class: "faint" }, found.fsm.errors[0]));
    } catch (error) {
      place.replaceChildren(make("p", { class: "faint" }, error.message));
    }
    place.removeAttribute("aria-busy");
  }

  let queue = Promise.resolve(); // one after the other: the service has few workers
  const seen = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) if (isIntersecting) {
      seen.unobserve(target);
      queue = queue.then(() => draw(target));
    }
  });

  async function replay(card) {
    stage.replaceChildren(make("p", { role: "status" }, "Running one instance …"));
    viewer.showModal();
    const given = { [card.dataset.kind]: card.dataset.id };
    await Mercator.replay(stage, { mission: given, fsms: [{ ...given, name: card.querySelector("h2").textContent.slice(0, 100) }] });
  }

  function chosen() {
    return cards.filter((card) => card.querySelector("[data-compare]").checked);
  }

  for (const card of cards) {
    seen.observe(card);
    card.querySelector("[data-replay]").addEventListener("click", () => replay(card));
    card.querySelector("[data-compare]").addEventListener("change", () => {
      at("compare").disabled = chosen().length < 2 || chosen().length > 6;
    });
    const change = (selector, action) => {
      const button = card.querySelector(selector);
      if (button) button.addEventListener("click", async () => {
        try {
          await action(button);
        } catch (error) {
          card.querySelector(".problem").textContent = error.message;
        }
      });
    };
    change("[data-share]", async (button) => {
      const { shared } = await api("PATCH", pathOf(card), { shared: button.dataset.share === "true" });
      button.dataset.share = String(!shared);
      button.textContent = shared ? "Keep to yourself" : "Share";
    });
    change("[data-delete]", async () => {
      if (!(await Mercator.confirmed("Delete this design? This cannot be undone."))) return;
      await api("DELETE", pathOf(card));
      card.remove();
    });
  }
  at("compare").addEventListener("click", () => {
    location.href = `/compare?${new URLSearchParams(chosen().map((card) => [card.dataset.kind, card.dataset.id]))}`;
  });
  at("close").addEventListener("click", () => viewer.close());
  viewer.addEventListener("close", () => stage.player && stage.player.pause());
})();
