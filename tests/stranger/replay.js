// The replay in a report's page, run by node: what it reckons is what the flight's own record says.
//
//     node replay.js REPORT.HTML TELEMETRY.HTML DIR
//
// DIR is the flight's directory, TELEMETRY.HTML the report by its telemetry alone. Exits 0 if every check holds, 1 otherwise.
"use strict";

const fs = require("fs");
const path = require("path");

const [page, telemetry, directory] = process.argv.slice(2);
const html = fs.readFileSync(page, "utf8");
const script = html.split("<script>//<![CDATA[\n")[1].split("//]]></script>")[0];
const loaded = { exports: {} };
new Function("module", script)(loaded);
const replay = loaded.exports;
function load(file) {
  return replay.decode(JSON.parse(fs.readFileSync(file, "utf8").split('id="replay-data">')[1].split("</script>")[0]));
}
const flight = load(page);

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

// Where the page has the very instant: positions, and what the world says was heard.
const instants = new Set(flight.t.map((t) => t.toFixed(4)));
let compared = 0, worst = 0, placed = 0, told = 0;
for (const row of rows) {
  const t = Number(row.at_s);
  if (!instants.has(t.toFixed(4))) continue;
  const state = replay.stateAt(flight, t + 1e-9);
  ["i", "j"].forEach((role, k) => {
    const there = [row[`${role}_east_m`], row[`${role}_north_m`], row[`${role}_up_m`]].map(Number);
    placed = Math.max(placed, Math.hypot(...there.map((c, n) => c - state.pair[k].p[n])));
  });
  // Of two rows of one instant the page shows the later one.
  if ((row.user_sinr !== "") !== Boolean(state.heard)) { told += 1; continue; }
  if (!state.heard) continue;
  const sinr = scene.eavesdroppers.map((_, k) => Number(row[`sinr_${k}`]));
  worst = Math.max(worst, Math.abs(10 * Math.log10(Number(row.user_sinr)) - state.heard.user));
  worst = Math.max(worst, Math.abs(10 * Math.log10(Math.max(...sinr)) - state.heard.eve));
  worst = Math.max(worst, Math.abs(Number(row.secrecy_rate_bps) / scene.radio.bandwidth_hz - state.heard.secrecy));
  compared += 1;
}
check(placed < 0.01, `positions are within ${(placed * 1000).toFixed(1)} mm of the record's`);
check(compared > 50 && told <= 4, `${compared} instants on the air compared, ${told} rows at the very change of a power`);
check(worst < 0.011, `SINR and secrecy rates shown are within ${worst.toFixed(4)} dB and bit/s/Hz of the world's`);

// The record that is made of telemetry has the figures of ideal antennas, by the program's own formula. The script's are the same,
// at the user, at the eavesdropper that hears best, and on the map there.
const estimated = load(telemetry);
let ideal = 0, off = 0;
for (const t of estimated.t) {
  const state = replay.stateAt(estimated, t + 1e-9);
  if (!state.heard || !state.user) continue;
  const pairs = [[state.heard.user, 10 * Math.log10(state.userSinr)], [state.heard.eve, 10 * Math.log10(state.eves[state.heard.which])]];
  for (const [program, script] of pairs) off = Math.max(off, Math.abs(program - script));
  const place = estimated.eves[state.heard.which].p;
  off = Math.max(off, Math.abs(replay.rateAt(estimated, state, place) - state.heard.secrecy));
  ideal += 1;
}
check(ideal > 50 && off < 0.2, `the script's figures are within ${off.toFixed(3)} dB and bit/s/Hz of the program's at ${ideal} instants`);

const place = replay.geodetic([scene.origin.lat_deg, scene.origin.lon_deg, scene.origin.alt_amsl_m], [0, 1000, 0]);
const north = (place[0] - scene.origin.lat_deg) * 111229;
check(Math.abs(north - 1000) < 1.5 && Math.abs(place[1] - scene.origin.lon_deg) < 1e-9, "a kilometre north is a kilometre of latitude");
process.exit(failed ? 1 : 0);
