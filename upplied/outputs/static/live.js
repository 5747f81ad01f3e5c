// What pages can do where the application serves them: sign in, ask, decide. A token stays in this tab alone.
"use strict";

(function () {
  const { element } = upplied;
  const button = (id, label, onclick, main) => element("button", { type: "button", id, class: main ? "main" : null, onclick }, label);
  const field = (label, input) => element("label", { class: "field" }, label, input);
  Object.assign(upplied, { button, field });

  upplied.signIn = async function (password) {
    const answer = await post("/login", { password });
    const content = await answer.json();
    if (content.token) window.sessionStorage.setItem("token", content.token);
    return content.refused || "";
  };

  // Whether the address held the password behind #, which a command prints there and no server sees.
  upplied.entered = (async () => {
    const password = decodeURIComponent(window.location.hash.slice(1));
    window.history.replaceState(null, "", window.location.pathname);
    return password !== "" && !(await upplied.signIn(password));
  })();

  // The answer to a request; `refused` says in words why there is none.
  upplied.ask = async function (address, request) {
    try {
      await upplied.entered;
      const answer = await post(address, request);
      if (answer.status !== 401) return await answer.json();
      return (await passwordGiven()) ? upplied.ask(address, request) : { refused: "Sign in to do this." };
    } catch { return { refused: "The program does not answer. Is it still running?" }; }
  };

  function post(address, request) {
    const headers = { "Content-Type": "application/json", Authorization: "Bearer " + (window.sessionStorage.getItem("token") || "") };
    return fetch(address, { method: "POST", headers, body: JSON.stringify(request || {}) });
  }

  // The fields for signing in; `done` runs once the password is right.
  upplied.signInForm = function (heading, done, ...further) {
    const input = element("input", { type: "password", id: "password", autocomplete: "current-password", required: true });
    const message = element("p", { class: "message refused", role: "status" });
    return element("form", { class: "login", onsubmit: async (event) => {
      event.preventDefault();
      message.textContent = await upplied.signIn(input.value);
      if (!message.textContent) done();
    } }, element(heading, {}, "Sign in"), field("Password", input), element("div", { class: "tools" }, element("button", { type: "submit", class: "main" }, "Sign in"), further), message);
  };

  // A dialog for the password; true once it is right.
  function passwordGiven() {
    return new Promise((done) => {
      const close = (signedIn) => { dialog.remove(); done(signedIn); };
      const dialog = element("dialog", { "aria-label": "Sign in", oncancel: () => close(false) }, upplied.signInForm("h2", () => close(true), button("cancel", "Cancel", () => close(false))));
      document.body.append(dialog);
      dialog.showModal();
    });
  }

  // Name and note of whoever decides, and a line for what came of it.
  upplied.signature = function () {
    const by = element("input", { type: "text", id: "by", autocomplete: "name", required: true });
    const note = element("input", { type: "text", id: "note" });
    const message = element("p", { class: "message", id: "message", role: "status" });
    const show = (text, refused = false) => { message.textContent = text; message.classList.toggle("refused", refused); };
    return {
      message, show, fields: element("div", { class: "fields" }, field("Your name", by), field("Note (optional)", note)),
      // The request with name and note, or null where the name is missing.
      sign(request) {
        if (by.value.trim()) return { ...request, by: by.value.trim(), note: note.value };
        show("Enter your name first.", true);
        by.focus();
        return null;
      },
    };
  };

  // Buttons that decide about a plan, with the name of whoever decides.
  upplied.decisions = function ({ id, known }) {
    const signature = upplied.signature();
    const decide = async (decision) => {
      const request = signature.sign({ decision, id, known });
      if (!request) return;
      signature.show("Storing the decision …");
      const answer = await upplied.ask("/decide", request);
      signature.show(answer.refused || answer.message, Boolean(answer.refused));
      if (!answer.refused) window.location.reload();
    };
    return element("fieldset", { class: "decide" }, element("legend", {}, "Decide"), signature.fields,
      element("div", { class: "tools" }, button("released", "Release", () => decide("released"), true),
        button("reviewed", "Mark as reviewed", () => decide("reviewed")), button("rejected", "Reject", () => decide("rejected"))), signature.message);
  };

  // The page of whoever is not signed in. A command opens it with the password behind #, which no server sees.
  upplied.pages.login = async function (app) {
    const reload = () => window.location.reload();
    if (await upplied.entered) { reload(); return; }
    app.append(upplied.fill(upplied.signInForm("h1", reload), upplied.note("The command that started the service prints the name of the file that holds the password.")));
    document.getElementById("password").focus();
  };
})();
