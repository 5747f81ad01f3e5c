// The verdict of a plan in one sentence, and the files that follow from it.
"use strict";

(function () {
  const { element, badge, list, note } = upplied;

  // The first plan in full; others where they are not flyable, a line each that opens.
  upplied.verdicts = (plans) => plans.filter((plan, at) => at === 0 || plan.status !== "ok").map((plan, at) => {
    const { flyable, headline, look } = plan.verdict;
    const title = [plan.preset + ": ", flyable ? "flyable " : "do not fly ", badge(plan.status)];
    const why = (text) => element("p", { class: "why" }, text);
    return element(at ? "details" : "section", { class: "verdict " + plan.status.replace(" ", "-") },
      element(at ? "summary" : "h2", {}, title), element("p", { class: "headline" }, headline),
      look.length ? [why(!flyable ? "Reason:" : look.length > 1 ? look.length + " warnings:" : "1 warning:"), list(look)]
        : flyable ? note("No warnings.") : why("No reason was recorded."));
  });

  // Missions in every format where the application writes them, files of a report folder, and the commands.
  upplied.downloads = function (data) {
    const plan = data.plans.find((each) => each.path);
    if (!plan) return null;
    const id = plan.provenance.transfer_id, released = plan.state === "released";
    const files = Object.entries(data.missions || {}).map(([label, where]) => where.startsWith("../")
      ? element("a", { class: "take", href: where, download: where.endsWith("/brief") ? null : "" }, label) : element("span", { class: "why" }, label + ": " + where));
    const command = (words, ...rest) => element("p", {}, element("code", {}, "upplied " + words), rest);
    return element("section", { class: "downloads" }, element("h2", {}, "Downloads"),
      element("div", { class: "tools" }, files, upplied.live ? element("a", { class: "take", href: "../studio/" + id }, "Edit in the studio") : null,
        element("button", { type: "button", id: "save-path", onclick: () => save(data.pair + ".csv", new Blob([csv(plan)], { type: "text/csv" })) }, "Path (CSV)")),
      released || files.length > 1 ? null : note("Mission files are available once a person releases the plan."),
      element("details", {}, element("summary", {}, "Commands"), released ? null : command("release " + id + " --by NAME"),
        command("export " + id + " --to qgc-plan -o " + data.target + ".plan", " (or mavlink, dji-wpml, litchi, kml, geojson, mcap, csv)")));
  };

  function save(name, content) {
    const address = URL.createObjectURL(content);
    element("a", { href: address, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10000);
  }

  // Metres in the structure's own frame; the page's arrays count from the middle of the structure.
  function csv(plan) {
    const { t, xyz, quat } = upplied.path(plan.path);
    const rows = Array.from(t, (time, at) => [time, ...Array.from(xyz.subarray(3 * at, 3 * at + 3), (value, axis) => value + plan.origin[axis]), ...quat.subarray(4 * at, 4 * at + 4)]);
    return ["t_s,x_m,y_m,z_m,qx,qy,qz,qw", ...rows.map((row) => row.map((value) => value.toFixed(4)).join(","))].join("\n") + "\n";
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
    canvas.toBlob((blob) => save(name + ".png", blob));
  };
})();
