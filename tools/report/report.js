// SPDX-License-Identifier: Apache-2.0
//
// Draws a report (tools/report/run_report.h) from the numbers in #data, with Chart.js.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const runs = data.runs;
const byId = (id) => document.getElementById(id);
const isDark = matchMedia("(prefers-color-scheme: dark)");
const palette = ["#1a7f8e", "#c9822b", "#7b5ea7", "#5c8a3a", "#b3261e", "#3f6fb5", "#a04f86", "#7d7d2f",
  "#5fb3c0", "#e8b878", "#b9a3d6", "#9cc47f", "#e58f89", "#92aede"];
// By data.bar_kinds: works, GPU segment, held, paced, at a gate, waits for the GPU.
const barColors = ["#9aa7b5", "#1a7f8e", "#c0392b", "#d9a441", "#8e5bb5", "#b5cde0"];
const causeColors = {};
data.causes.forEach((cause, i) => { causeColors[cause.cause] = palette[i % palette.length]; });

const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const number = (value, digits = 1) => value.toFixed(digits);
const charts = [];

/// A new element with text, never HTML: names come from the program that was run.
function element(tag, text = "", className = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

function row(cells, tag = "td") {
  const made = element("tr");
  for (const cell of cells)
    made.append(cell instanceof Node ? cell : element(tag, String(cell)));
  return made;
}

function draw(canvas, config) {
  config.options = Object.assign({ responsive: true, maintainAspectRatio: false, animation: false },
    config.options);
  const chart = new Chart(canvas, config);
  charts.push(chart);
  return chart;
}

const axis = (title, more = {}) =>
  Object.assign({ title: { display: Boolean(title), text: title }, beginAtZero: true }, more);

/// Draws a vertical line at options.plugins.lines: [{x, text}].
const verticalLines = {
  id: "lines",
  afterDatasetsDraw(chart, _, options) {
    const { ctx, chartArea, scales } = chart;
    for (const line of options.at || []) {
      const x = scales.x.getPixelForValue(line.x);
      if (x < chartArea.left || x > chartArea.right) continue;
      ctx.save();
      ctx.strokeStyle = ctx.fillStyle = color(line.color || "--bad");
      ctx.setLineDash([4, 3]);
      ctx.beginPath();
      ctx.moveTo(x, chartArea.top);
      ctx.lineTo(x, chartArea.bottom);
      ctx.stroke();
      const isFar = x > (chartArea.left + chartArea.right) / 2;
      ctx.textAlign = isFar ? "right" : "left";
      ctx.fillText(line.text, x + (isFar ? -4 : 4), chartArea.top + 10);
      ctx.restore();
    }
  },
};
Chart.register(verticalLines);

function chainNames() {
  const names = [];
  for (const run of runs) for (const chain of run.chains) if (!names.includes(chain.name)) names.push(chain.name);
  return names;
}
const chainOf = (run, name) => run.chains.find((chain) => chain.name === name);

function showRuns() {
  const place = byId("runs");
  for (const run of runs) {
    const card = element("div", "", "card");
    card.append(element("h3", run.label));
    let words = `${run.program} (pid ${run.pid}), ${number(run.seconds)} s from ${run.date}: ` +
      `${number(run.missed.pct)} % of the frames missed (${number(run.missed.low_pct)} to ` +
      `${number(run.missed.high_pct)}), ${number(run.mean_missed_pct)} % in the mean over the chains.`;
    if (run.gpu)
      words += ` GPU segments were under way ${number(run.gpu.busy_pct, 0)} % of the time; by the plans what ` +
        `was launched takes ${number(run.gpu.planned_pct, 0)} % of it alone.`;
    if (run.cpu_cores !== undefined) words += ` The process used ${number(run.cpu_cores, 2)} cores.`;
    card.append(element("p", words));
    place.append(card);
    if (run.is_simulated)
      place.append(element("div", "Simulated GPU. Kernels take modelled time and compute nothing: this shows how " +
        "the scheduler behaves, not how fast any hardware is.", "card warning"));
    for (const warning of run.warnings) place.append(element("div", warning, "card warning"));
    if (run.overwritten > 0)
      place.append(element("div", `${run.overwritten} older records were overwritten: this is what the flight ` +
        "recorder has kept, and counts are of that alone.", "card warning"));
  }
}

function showChains() {
  const table = element("table");
  const head = ["chain", "run", "deadline", "frames", "late", "dropped", "missed %", "95 %", "median", "p95",
    "p99", "max", "held", "paced", "late most often"];
  table.append(row(head, "th"));
  for (const name of chainNames()) {
    let isFirst = true;
    for (const run of runs) {
      const chain = chainOf(run, name);
      if (!chain) continue;
      const missed = element("td", number(chain.missed.pct), chain.missed.pct > 0 ? "bad" : "");
      const cause = chain.causes.length ? `${chain.causes[0].frames} x ${chain.causes[0].words}` : "";
      const made = row([isFirst ? name : "", runs.length > 1 ? run.label : "", number(chain.deadline_ms),
        chain.frames, chain.late, chain.dropped, missed,
        `${number(chain.missed.low_pct)}..${number(chain.missed.high_pct)}`, number(chain.median_ms),
        number(chain.p95_ms), number(chain.p99_ms), number(chain.max_ms), number(chain.held_ms),
        number(chain.paced_ms), element("td", cause, "words")]);
      if (isFirst) made.className = "first";
      table.append(made);
      isFirst = false;
    }
  }
  byId("chains").append(table);
}

function drawMissed() {
  const names = chainNames();
  const datasets = runs.map((run, i) => ({
    label: run.label,
    backgroundColor: palette[i % palette.length],
    data: names.map((name) => (chainOf(run, name) ? chainOf(run, name).missed.pct : null)),
  }));
  draw(byId("missed"), {
    type: "bar",
    data: { labels: names, datasets },
    options: {
      scales: { y: axis("%") },
      plugins: {
        legend: { display: runs.length > 1 },
        tooltip: { callbacks: { afterLabel: (item) => {
          const chain = chainOf(runs[item.datasetIndex], item.label);
          return `95 %: ${number(chain.missed.low_pct)} to ${number(chain.missed.high_pct)}; ${chain.frames} frames`;
        } } },
      },
    },
  });
}

function drawCauses() {
  const names = chainNames();
  const labels = [];
  for (const name of names) for (const run of runs) labels.push(runs.length > 1 ? `${name}, ${run.label}` : name);
  const datasets = data.causes.map((cause) => ({
    label: cause.words,
    backgroundColor: causeColors[cause.cause],
    data: names.flatMap((name) => runs.map((run) => {
      const chain = chainOf(run, name);
      if (!chain) return 0;
      if (cause.cause === "dropped") return chain.dropped;
      return chain.causes.filter((its) => its.cause === cause.cause).reduce((sum, its) => sum + its.frames, 0);
    })),
  })).filter((dataset) => dataset.data.some((value) => value > 0));
  draw(byId("causes"), {
    type: "bar",
    data: { labels, datasets },
    options: { scales: { x: { stacked: true }, y: axis("frames", { stacked: true, ticks: { precision: 0 } }) } },
  });
}

function drawLatency() {
  const choice = byId("latency-chain");
  for (const name of chainNames()) choice.append(element("option", name));
  const cumulative = (latencies) =>
    latencies.map((ms, i) => ({ x: ms, y: (100 * (i + 1)) / latencies.length }));
  const datasets = () => runs.map((run, i) => ({
    label: run.label,
    borderColor: palette[i % palette.length],
    backgroundColor: palette[i % palette.length],
    pointRadius: 0,
    stepped: "before",
    borderWidth: 2,
    data: chainOf(run, choice.value) ? cumulative(chainOf(run, choice.value).latencies_ms) : [],
  }));
  const lines = () => [...new Set(runs.map((run) => chainOf(run, choice.value)).filter(Boolean)
    .map((chain) => chain.deadline_ms))].map((ms) => ({ x: ms, text: `deadline ${number(ms)} ms` }));
  const reach = () => {
    const all = runs.flatMap((run) => (chainOf(run, choice.value) ? chainOf(run, choice.value).latencies_ms : []));
    return 1.05 * Math.max(...lines().map((line) => line.x), ...all.slice(-1), ...runs.map((run) =>
      (chainOf(run, choice.value) ? chainOf(run, choice.value).max_ms : 0)));
  };
  const chart = draw(byId("latency"), {
    type: "line",
    data: { datasets: datasets() },
    options: {
      parsing: false,
      interaction: { mode: "nearest", axis: "x", intersect: false },
      scales: {
        x: axis("latency, ms", { type: "linear", min: 0, max: reach() }),
        y: axis("% of frames", { min: 0, max: 100 }),
      },
      plugins: { legend: { display: runs.length > 1 }, lines: { at: lines() },
        tooltip: { callbacks: { title: () => "", label: (item) =>
          `${item.dataset.label}: ${number(item.parsed.y)} % took at most ${number(item.parsed.x, 2)} ms` } } },
    },
  });
  choice.onchange = () => {
    chart.data.datasets = datasets();
    chart.options.plugins.lines.at = lines();
    chart.options.scales.x.max = reach();
    chart.update();
  };
}

function drawOverTime() {
  for (const run of runs) {
    const card = element("div", "", "card");
    card.append(element("h3", `Missed frames every ${run.bin_s} s` + (runs.length > 1 ? `: ${run.label}` : "")));
    const plot = element("div", "", "plot"), canvas = element("canvas");
    plot.append(canvas);
    card.append(plot);
    byId("over-time").append(card);
    const datasets = data.causes.map((cause) => ({
      label: cause.words,
      backgroundColor: causeColors[cause.cause],
      data: run.over_time.map((bin) => bin.missed[cause.cause] || 0),
    })).filter((dataset) => dataset.data.some((value) => value > 0));
    if (!datasets.length) datasets.push({ label: "missed", data: run.over_time.map(() => 0) });
    const scales = { x: axis("s", { stacked: true }), y: axis("frames", { stacked: true, ticks: { precision: 0 } }) };
    if (run.over_time.some((bin) => bin.cpu_cores !== undefined)) {
      datasets.push({ type: "line", label: "CPU cores", yAxisID: "cores", borderColor: color("--soft"),
        backgroundColor: color("--soft"), pointRadius: 0, borderWidth: 1.5, stack: "cores",
        data: run.over_time.map((bin) => (bin.cpu_cores === undefined ? null : bin.cpu_cores)) });
      scales.cores = axis("cores", { position: "right", grid: { drawOnChartArea: false } });
    }
    draw(canvas, { type: "bar", data: { labels: run.over_time.map((bin) => number(bin.begin_s, run.bin_s < 1 ? 1 : 0)), datasets },
      options: { scales, plugins: { tooltip: { mode: "index" } } } });
  }
}

function drawGpu() {
  const known = runs.map((run, i) => ({ run, i })).filter(({ run }) => run.gpu);
  if (!known.length) {
    byId("gpu").replaceChildren(element("p", "No GPU segments were recorded: UrgenGo only observed.", "soft"));
    return;
  }
  const share = (canvas, key, from) => {
    const most = Math.max(...known.map(({ run }) => run.gpu[key].reduce((last, pct, n) => (pct > 0.005 ? n : last), from)));
    const labels = [];
    for (let n = from; n <= most; ++n) labels.push(String(n));
    draw(canvas, {
      type: "bar",
      data: { labels, datasets: known.map(({ run, i }) => ({ label: run.label, backgroundColor: palette[i % palette.length],
        data: labels.map((n) => run.gpu[key][Number(n)] || 0) })) },
      options: { scales: { x: axis("chains"), y: axis("% of the time") }, plugins: { legend: { display: runs.length > 1 } } },
    });
  };
  share(byId("sharing"), "by_chains_pct", 0);
  share(byId("collisions"), "collisions_pct", 2);
}

function showConditions() {
  for (const run of runs) {
    const card = element("div", "", "card");
    if (runs.length > 1) card.append(element("h3", run.label));
    const list = element("dl");
    for (const fact of run.conditions.facts) list.append(element("dt", fact.name), element("dd", fact.value));
    list.append(element("dt", "records"), element("dd", `${run.records}, lost ${run.lost}, overwritten ${run.overwritten}`));
    if (run.gates) list.append(element("dt", "gates"), element("dd", run.gates));
    card.append(list);
    if (run.conditions.config) {
      const details = element("details");
      details.append(element("summary", "Config, as it was used"), element("pre", run.conditions.config));
      card.append(details);
    }
    byId("conditions").append(card);
  }
}

function useColors() {
  Chart.defaults.color = color("--soft");
  Chart.defaults.borderColor = color("--line");
  for (const chart of charts) {
    for (const scale of Object.values(chart.options.scales || {})) {
      scale.ticks = Object.assign(scale.ticks || {}, { color: color("--soft") });
      scale.grid = Object.assign(scale.grid || {}, { color: color("--line") });
    }
    chart.update("none");
  }
}

useColors();
showRuns();
showChains();
drawMissed();
drawCauses();
drawLatency();
drawOverTime();
drawGpu();
showMisses();
showConditions();
isDark.addEventListener("change", useColors);
