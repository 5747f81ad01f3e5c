// What a pilot reads first: a map and the heights of the mission, its time, battery and photos.
"use strict";

(function () {
  const { element, entry, format, minutes, note, tile } = upplied;

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
})();
