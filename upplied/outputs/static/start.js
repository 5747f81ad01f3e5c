// Shows the page that a document holds, or one of all those in a single file, by the address behind #.
"use strict";

(function () {
  const app = document.getElementById("app");
  const data = JSON.parse(document.getElementById("data").textContent), { pairs, root, live } = data;
  Object.assign(upplied, { root, live });
  Object.assign(upplied.structures, data.structures || {});
  // Where pages are: beside each other in a folder, behind # in a single file.
  upplied.link = (room, name) => (pairs ? (room === "transfers" ? "#" + name : null) : root + room + "/" + name + ".html");
  upplied.home = pairs ? "#" : root + "index.html";
  let leave = null;

  function show() {
    const pair = pairs && pairs[decodeURIComponent(window.location.hash.slice(1))];
    const kind = pair ? "transfer" : Object.keys(upplied.pages).find((each) => each in data);
    if (leave) leave();
    app.replaceChildren();
    window.scrollTo(0, 0);
    leave = upplied.pages[kind](app, pair || data[kind]);
  }

  if (pairs) window.addEventListener("hashchange", show);
  show();
})();
