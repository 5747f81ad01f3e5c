// Decides what a document shows: the fleet, one transfer, or both in a single file, told apart by the address.
"use strict";

(function () {
  const app = document.getElementById("app");
  const data = JSON.parse(document.getElementById("data").textContent);
  let leave = null;

  function show() {
    const wanted = decodeURIComponent(window.location.hash.slice(1));
    if (leave) leave();
    leave = null;
    app.replaceChildren();
    window.scrollTo(0, 0);
    const transfer = data.pairs && data.pairs[wanted] ? data.pairs[wanted] : data.transfer;
    if (transfer) leave = upplied.pages.transfer(app, transfer, data.pairs ? "#" : data.back);
    else leave = upplied.pages.fleet(app, data.fleet, (pair) => (data.pairs ? "#" : "transfers/") + pair + (data.pairs ? "" : ".html"),
      data.pairs ? null : (demonstration) => "demonstrations/" + demonstration + ".html");
  }

  Object.assign(upplied.structures, data.structures || {});
  if (data.pairs) window.addEventListener("hashchange", show);
  show();
})();
