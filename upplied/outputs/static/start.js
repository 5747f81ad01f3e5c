// Decides what a document shows: the fleet, a structure, a plan, or all in a single file, told apart by the address.
"use strict";

(function () {
  const app = document.getElementById("app");
  const data = JSON.parse(document.getElementById("data").textContent);
  Object.assign(upplied, { root: data.root, live: data.live });
  Object.assign(upplied.structures, data.structures || {});
  // Where pages are: beside each other in a folder, behind # in a single file.
  upplied.link = (room, name) => (data.pairs ? (room === "transfers" ? "#" + name : null) : data.root + room + "/" + name + ".html");
  upplied.home = data.pairs ? "#" : data.root + "index.html";
  let leave = null;

  function show() {
    const name = decodeURIComponent(window.location.hash.slice(1));
    if (leave) leave();
    leave = null;
    app.replaceChildren();
    window.scrollTo(0, 0);
    const transfer = data.pairs && data.pairs[name] ? data.pairs[name] : data.transfer;
    if (transfer) leave = upplied.pages.transfer(app, transfer);
    else if (data.structure) upplied.pages.structure(app, data.structure);
    else if (data.about) upplied.pages.about(app, data.about);
    else leave = upplied.pages.fleet(app, data.fleet);
  }

  if (data.pairs) window.addEventListener("hashchange", show);
  show();
})();
