/* Run pages without a browser: node live_runs.js PLAYER FOLDER JOBS; print their states as JSON.

   A job has a page, sliders to set at the start, and times with the sliders to set there. */
"use strict";
const [player, folder, jobs] = process.argv.slice(2);
require(player);
require(`${folder}/kernels.js`);
(async () => {
  const module = await WebAssembly.compile(Buffer.from(flexarm.kernels, "base64"));
  const results = [];
  for (const {page, sliders, times, last} of JSON.parse(jobs)) {
    require(`${folder}/${page}.js`);
    const shown = await flexarm.Player.load(null, structuredClone(flexarm.scenes[page]), module);
    for (const [name, value] of Object.entries(sliders)) shown.set(name, value);
    for (const [time, later] of times) {
      shown.runTo(time);
      for (const [name, value] of Object.entries(later)) shown.set(name, value);
    }
    shown.runTo(last);
    results.push(shown.runs.map(run => ({
      label: run.label, error: run.error, traces: run.traces,
      states: Array.from({length: shown.sample + 1}, (_, k) => Array.from(run.state(k))),
    })));
  }
  console.log(JSON.stringify(results));
})();
