"use strict";
// What all pages share: requests to the API, and their errors as text.
const Mercator = {
  /** The answer of the API as data; throws an Error with a message for each mistake. */
  async api(method, path, body, headers = {}) {
    const options = { method, headers: { ...headers } };
    if (body !== undefined) {
      options.headers["Content-Type"] = "application/json";
      options.body = JSON.stringify(body);
    }
    const answer = await fetch(`/api/v1${path}`, options);
    const text = await answer.text();
    let data = null;
    try { data = text ? JSON.parse(text) : null; } catch { data = null; }
    if (!answer.ok) throw new Error((data && data.errors ? data.errors : [`${answer.status} ${answer.statusText}`]).join("\n"));
    return data;
  },
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
};
