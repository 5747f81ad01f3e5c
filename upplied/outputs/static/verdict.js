// What a person reads first of a transfer, and what of it can be taken along.
"use strict";

(function () {
  const { element, badge } = upplied;

  // The plan that would be flown in full; others where they are not flyable, a line each that opens.
  upplied.verdicts = function (plans) {
    return plans.filter((plan, at) => at === 0 || plan.status !== "ok").map((plan, at) => {
      const { flyable, headline, look } = plan.verdict;
      const title = [plan.preset + ": ", flyable ? "flyable " : "not to be flown ", badge(plan.status)];
      return element(at ? "details" : "section", { class: "verdict " + plan.status.replace(" ", "-") },
        at ? element("summary", {}, title) : element("h2", {}, title),
        element("p", {}, headline),
        look.length ? element("p", { class: "why" }, flyable ? "Look at this before it is flown:" : "Why:") : null,
        look.length ? element("ul", {}, look.map((each) => element("li", {}, each))) : null,
        flyable && !look.length ? element("p", { class: "note" }, "Nothing stands out.") : null,
        !flyable && !look.length ? element("p", { class: "why" }, "No reason was recorded.") : null);
    });
  };

  // The path of the plan as a file, a picture of both views, and how a mission is made, which passes its checks.
  upplied.downloads = function (data, panes) {
    const plan = data.plans.find((each) => each.path);
    if (!plan) return null;
    const id = plan.provenance.transfer_id;
    return element("div", { class: "tools downloads" },
      button("Path (CSV)", () => save(data.pair + ".csv", "text/csv", csv(plan))),
      button("Picture (PNG)", () => picture(data.pair, panes)),
      Object.entries(data.missions || {}).map(([label, where]) => where.startsWith("../")
        ? element("a", { class: "take", href: where, download: "" }, "Mission (" + label + ")") : element("span", { class: "why" }, label + ": " + where)),
      element("span", { class: "note" }, "By command: "),
      plan.decided.startsWith("draft") ? element("code", {}, "upplied release " + id + " --by NAME;") : null,
      element("code", {}, "upplied export " + id + " --to qgc-plan -o " + data.target + ".plan"),
      element("span", { class: "note" }, "(or mavlink, dji-wpml, litchi, kml, geojson, mcap, csv)"));
  };

  function button(label, onclick) { return element("button", { type: "button", onclick }, label); }

  function save(name, type, content) {
    const address = URL.createObjectURL(new Blob([content], { type }));
    element("a", { href: address, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  }

  // Metres in the structure's own frame; the page's arrays count from the middle of the structure.
  function csv(plan) {
    const path = upplied.path(plan.path);
    const { t, xyz, quat } = path;
    const rows = ["t_s,x_m,y_m,z_m,qx,qy,qz,qw"];
    const from = plan.origin;
    for (let i = 0; i < path.count; i++) {
      rows.push([t[i], ...[0, 1, 2].map((axis) => xyz[3 * i + axis] + from[axis]), ...quat.slice(4 * i, 4 * i + 4)].map((value) => Number(value).toFixed(4)).join(","));
    }
    return rows.join("\n") + "\n";
  }

  async function picture(name, panes) {
    const canvas = element("canvas", { width: 1600, height: 700 });
    const context = canvas.getContext("2d");
    context.fillStyle = upplied.colour("--paper");
    context.fillRect(0, 0, 1600, 700);
    for (const [at, pane] of panes.entries()) {
      const image = new Image();
      image.src = await Plotly.toImage(pane, { format: "png", width: 800, height: 700 });
      await image.decode();
      context.drawImage(image, 800 * at, 0);
    }
    canvas.toBlob((blob) => save(name + ".png", "image/png", blob));
  }
})();
