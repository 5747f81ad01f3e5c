// What pages can do where the application serves them: sign in, ask, decide. A token stays in this tab alone.
"use strict";

(function () {
  const { element } = upplied;

  upplied.signIn = async function (password) {
    const answer = await post("/login", { password });
    const content = await answer.json();
    if (content.token) window.sessionStorage.setItem("token", content.token);
    return content.refused || "";
  };

  // Whether the address held the password behind #, which a command prints there and no server sees.
  upplied.entered = (async () => {
    const given = decodeURIComponent(window.location.hash.slice(1));
    window.history.replaceState(null, "", window.location.pathname);
    return given !== "" && !(await upplied.signIn(given));
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

  // A dialog for the password; true once it is right.
  function passwordGiven() {
    return new Promise((done) => {
      const field = element("input", { type: "password", id: "dialog-password", autocomplete: "current-password", required: true });
      const message = element("p", { class: "message refused", role: "status" });
      const close = (value) => { dialog.remove(); done(value); };
      const form = element("form", { onsubmit: async (event) => {
        event.preventDefault();
        message.textContent = await upplied.signIn(field.value);
        if (!message.textContent) close(true);
      } }, element("h2", {}, "Sign in"), element("label", { class: "field" }, "Password", field), message,
      element("div", { class: "tools" }, element("button", { type: "submit" }, "Sign in"), element("button", { type: "button", onclick: () => close(false) }, "Cancel")));
      const dialog = element("dialog", { "aria-label": "Sign in", oncancel: () => close(false) }, form);
      document.body.append(dialog);
      dialog.showModal();
    });
  }

  // Buttons that decide about a plan, with the name of whoever decides.
  upplied.decisions = function (plan) {
    const by = element("input", { type: "text", id: "by", autocomplete: "name", required: true });
    const note = element("input", { type: "text", id: "note" });
    const message = element("p", { class: "message", id: "message", role: "status" });
    let known = plan.known;
    const button = (decision, label, main) => element("button", { type: "button", id: decision, class: main ? "main" : null, onclick: async () => {
      if (!by.value.trim()) { message.textContent = "Enter your name first."; message.classList.add("refused"); by.focus(); return; }
      message.textContent = "Storing the decision …";
      const answer = await upplied.ask("/decide", { decision, id: plan.id, known, by: by.value.trim(), note: note.value });
      message.textContent = answer.refused || answer.message;
      message.classList.toggle("refused", Boolean(answer.refused));
      if (!answer.refused) window.location.reload();
    } }, label);
    return element("fieldset", { class: "decide" }, element("legend", {}, "Decide"),
      element("div", { class: "fields" }, element("label", { class: "field" }, "Your name", by), element("label", { class: "field" }, "Note (optional)", note)),
      element("div", { class: "tools" }, button("released", "Release", true), button("reviewed", "Mark as reviewed"), button("rejected", "Reject")), message);
  };
})();
