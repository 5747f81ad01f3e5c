// The verdict of a plan in one sentence, and the files that follow from it.
"use strict";

(function () {
  const { element, badge } = upplied;

  // The first plan in full; others where they are not flyable, a line each that opens.
  upplied.verdicts = function (plans) {
    return plans.filter((plan, at) => at === 0 || plan.status !== "ok").map((plan, at) => {
      const { flyable, headline, look } = plan.verdict;
      const title = [plan.preset + ": ", flyable ? "flyable " : "do not fly ", badge(plan.status)];
      return element(at ? "details" : "section", { class: "verdict " + plan.status.replace(" ", "-") },
        at ? element("summary", {}, title) : element("h2", {}, title),
        element("p", { class: "headline" }, headline),
        look.length ? element("p", { class: "why" }, flyable ? (look.length > 1 ? look.length + " warnings:" : "1 warning:") : "Reason:") : null,
        look.length ? element("ul", {}, look.map((each) => element("li", {}, each))) : null,
        flyable && !look.length ? element("p", { class: "note" }, "No warnings.") : null,
        !flyable && !look.length ? element("p", { class: "why" }, "No reason was recorded.") : null);
    });
  };

  // Missions in every format where the application writes them, files of a report folder, and the commands.
  upplied.downloads = function (data) {
    const plan = data.plans.find((each) => each.path);
    if (!plan) return null;
    const id = plan.provenance.transfer_id, released = plan.state === "released";
    const files = Object.entries(data.missions || {}).map(([label, where]) => where.startsWith("../")
      ? element("a", { class: "take", href: where, download: where.endsWith("/brief") ? null : "" }, label) : element("span", { class: "why" }, label + ": " + where));
    return element("section", { class: "downloads" }, element("h2", {}, "Downloads"),
      element("div", { class: "tools" }, files, upplied.live ? element("a", { class: "take", href: "../studio/" + id }, "Edit in the studio") : null,
        element("button", { type: "button", id: "save-path", onclick: () => save(data.pair + ".csv", "text/csv", csv(plan)) }, "Path (CSV)")),
      released || files.length > 1 ? null : element("p", { class: "note" }, "Mission files are available once a person releases the plan."),
      element("details", {}, element("summary", {}, "Commands"),
        released ? null : element("p", {}, element("code", {}, "upplied release " + id + " --by NAME")),
        element("p", {}, element("code", {}, "upplied export " + id + " --to qgc-plan -o " + data.target + ".plan"), " (or mavlink, dji-wpml, litchi, kml, geojson, mcap, csv)")));
  };

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

  upplied.picture = async function (name, panes) {
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
  };
})();
