// The replay in a report's page, run by node: what it reckons is what the flight's own record says.
//
//     node replay.js REPORT.HTML DIR
//
// DIR is the flight's directory. Exits 0 if every check holds, 1 otherwise.
"use strict";

const fs = require("fs");
const path = require("path");

const [page, directory] = process.argv.slice(2);
const html = fs.readFileSync(page, "utf8");
const raw = JSON.parse(html.split('id="replay-data">')[1].split("</script>")[0]);
const script = html.split("<script>//<![CDATA[\n")[1].split("//]]></script>")[0];
const loaded = { exports: {} };
new Function("module", script)(loaded);
const replay = loaded.exports;
const flight = replay.decode(raw);

let failed = false;
function check(held, what) {
  console.log((held ? "ok   " : "FAIL ") + what);
  failed = failed || !held;
}

const scene = JSON.parse(fs.readFileSync(path.join(directory, "scene.json"), "utf8"));
const lines = fs.readFileSync(path.join(directory, "timeline.csv"), "utf8").trim().split("\n");
const names = lines[0].split(",");
const rows = lines.slice(1).map((line) => {
  const row = {};
  line.split(",").forEach((cell, k) => { row[names[k]] = cell; });
  return row;
});
check(Math.abs(flight.t[flight.t.length - 1] - Number(rows[rows.length - 1].at_s)) < 1e-3, `${flight.t.length} instants of ${rows.length} rows`);

// Where the page has the very instant, the world's own SINR at the user and at every eavesdropper.
const instants = new Set(flight.t.map((t) => t.toFixed(4)));
let compared = 0, worst = 0, placed = 0, told = 0;
for (const row of rows) {
  const t = Number(row.at_s);
  if (!instants.has(t.toFixed(4))) continue;
  // Of two rows of one instant the page shows the later one.
  const state = replay.stateAt(flight, t + 1e-9);
  ["i", "j"].forEach((role, k) => {
    const there = [row[`${role}_east_m`], row[`${role}_north_m`], row[`${role}_up_m`]].map(Number);
    const off = Math.hypot(...there.map((c, n) => c - state.pair[k].p[n]));
    placed = Math.max(placed, off);
  });
  const on = row.user_sinr !== "";
  if (on !== Boolean(state.user)) { told += 1; continue; }
  if (!on) continue;
  const sinr = [[row.user_sinr, state.userSinr]].concat(scene.eavesdroppers.map((_, k) => [row[`sinr_${k}`], state.eves[k]]));
  for (const [world, page] of sinr) worst = Math.max(worst, Math.abs(Math.log2(1 + Number(world)) - Math.log2(1 + page)));
  worst = Math.max(worst, Math.abs(Number(row.secrecy_rate_bps) / scene.radio.bandwidth_hz - state.secrecy));
  // The map's figure at the strongest listener's place is the secrecy rate.
  const place = scene.eavesdroppers[state.strongest].true_position_enu_m;
  worst = Math.max(worst, Math.abs(replay.rateAt(flight, state, place) - state.secrecy));
  compared += 1;
}
check(placed < 0.01, `positions are within ${(placed * 1000).toFixed(1)} mm of the record's`);
check(compared > 50, `${compared} instants on the air compared`);
check(told <= 4, `${told} rows at the very change of a power`);
check(worst < 0.02, `rates at user and eavesdroppers, and the map's there, within ${worst.toExponential(1)} bit/s/Hz of the world's`);

const place = replay.geodetic([scene.origin.lat_deg, scene.origin.lon_deg, scene.origin.alt_amsl_m], [0, 1000, 0]);
const north = (place[0] - scene.origin.lat_deg) * 111229;
check(Math.abs(north - 1000) < 1.5 && Math.abs(place[1] - scene.origin.lon_deg) < 1e-9, "a kilometre north is a kilometre of latitude");
process.exit(failed ? 1 : 0);
