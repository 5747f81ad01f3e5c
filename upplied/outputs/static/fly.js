// What a pilot reads and takes along: the verdict, map and heights of the mission, its time, battery, photos and files.
"use strict";

(function () {
  const { element, badge, entry, format, list, minutes, note, tile } = upplied;

  upplied.fly = function (data, plan) {
    const { mission } = data, flights = mission.flights_s;
    const drawings = [["map", "Map" + (flights ? ", north up" : ", +X of the structure to the right")],
      ["heights", "Heights above " + (flights ? "take-off" : "ground") + ", by distance flown"]];
    return element("div", {},
      mission.refused ? note("No mission can be written yet: " + mission.refused, "no-mission") : null,
      element("div", { class: "drawings" }, drawings.map(([id, title]) => element("figure", {}, element("figcaption", {}, title), element("img", { id, src: mission[id], alt: title + " of " + data.target })))),
      element("p", { class: "legend" }, mission.legend.map((each) => entry(...each))),
      tiles(plan, mission, flights), battery(data, mission, flights));
  };

  function tiles({ measures, safety_m: limit }, mission, flights) {
    const total = flights ? flights.reduce((sum, time) => sum + time, 0) : measures.duration_s;
    const tall = (value, label, digits, help) => tile(format(value, digits, " m"), label, "", help);
    return element("div", { class: "tiles", id: "tiles" },
      tile(minutes(total), flights ? (flights.length > 1 ? flights.length + " flights, take-off to landing" : "take-off to landing") : "inspection time"),
      tall(measures.min_clearance_m, "minimum clearance" + (limit ? " (limit " + limit + " m)" : ""), 1),
      flights ? [
        tile(String(mission.photos), "photos"),
        tile(format(mission.shown_pct, 1, " %"), "inspected surface shown by the photos", "", "No coarser than 1.25 times the finest look of the path"),
        tile(format(mission.interval_s, 1, " s"), "shortest photo interval"),
        tile(upplied.megabytes(mission.storage_mb), "storage" + (mission.assumed_camera ? ", at 20 megapixels" : ""), "", "0.4 MB per megapixel of a JPEG"),
        tall(mission.return_m, "return-to-home height, at least", 0, "Above take-off: an automatic return at this height passes over everything"),
        tall(mission.transit_m, "height of transit legs, above take-off", 1),
        tall(mission.highest_m, "highest point, above take-off", 1),
        tile(mission.home_deg.map((each) => each.toFixed(6)).join(", "), "take-off (latitude, longitude)"),
      ] : tall(measures.path_length_m, "path length", 0));
  }

  // One bar for each flight: the share of a battery that it takes; the reserve is marked.
  function battery({ target }, mission, flights) {
    if (!flights) return null;
    const share = (seconds) => (100 * seconds) / mission.endurance_s;
    if (!mission.endurance_s) return note("Battery not checked: set the endurance of the vehicle (upplied set " + target + " vehicle.endurance_s=SECONDS --by NAME) and plan again.", "battery");
    return element("div", { id: "battery" }, flights.map((time, at) => {
      const words = "Flight " + (at + 1) + ": " + minutes(time) + ", " + share(time).toFixed(0) + " % of a battery (limit " + share(mission.usable_s).toFixed(0) + " %)";
      const [taken, reserve] = [element("i", {}), element("u", {})];
      taken.style.width = Math.min(100, share(time)) + "%";
      reserve.style.left = share(mission.usable_s) + "%";
      return element("p", {}, words, element("div", { class: "battery" + (time > mission.usable_s ? " over" : ""), role: "meter",
        "aria-valuemin": 0, "aria-valuemax": 100, "aria-valuenow": share(time).toFixed(0), "aria-label": words }, taken, reserve));
    }));
  }

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
