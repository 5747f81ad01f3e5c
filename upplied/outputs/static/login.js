// The page of whoever is not signed in. A command opens it with the password behind #, which no server sees.
"use strict";

(async function () {
  const { element } = upplied;
  if (await upplied.entered) { window.location.reload(); return; }
  const field = element("input", { type: "password", id: "password", autocomplete: "current-password", required: true });
  const message = element("p", { class: "message refused", role: "status" });
  document.getElementById("app").append(element("form", { class: "login", onsubmit: async (event) => {
    event.preventDefault();
    message.textContent = await upplied.signIn(field.value);
    if (!message.textContent) window.location.reload();
  } }, element("h1", {}, "Sign in"), element("label", { class: "field" }, "Password", field),
  element("div", { class: "tools" }, element("button", { type: "submit", class: "main" }, "Sign in")), message,
  element("p", { class: "note" }, "The command that started the service prints the name of the file that holds the password.")));
  field.focus();
})();
