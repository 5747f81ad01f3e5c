// The page of whoever is not signed in. A command opens it with the password behind #, which no server sees.
"use strict";

(async function () {
  if (await upplied.entered) { window.location.reload(); return; }
  const form = upplied.signInForm("h1", () => window.location.reload());
  document.getElementById("app").append(upplied.fill(form, upplied.note("The command that started the service prints the name of the file that holds the password.")));
  form.querySelector("input").focus();
})();
