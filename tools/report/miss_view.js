// SPDX-License-Identifier: Apache-2.0
//
// Late frames, one by one: what all tasks did around the one that is chosen, and its story. What it
// uses of report.js is there by the time that it is called.
"use strict";

/// Wheel and drag move and stretch the x axis between its first bounds; a double click undoes it.
function makeZoomable(chart, canvas) {
  const first = { min: chart.options.scales.x.min, max: chart.options.scales.x.max };
  const show = (min, max) => {
    const length = Math.min(max - min, first.max - first.min);
    const begin = Math.max(first.min, Math.min(min, first.max - length));
    Object.assign(chart.options.scales.x, { min: begin, max: begin + length });
    chart.update("none");
  };
  const stretch = (factor, at) => {
    const { min, max } = chart.options.scales.x;
    show(at - (at - min) * factor, at + (max - at) * factor);
  };
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    stretch(event.deltaY < 0 ? 0.8 : 1.25, chart.scales.x.getValueForPixel(event.offsetX));
  }, { passive: false });
  let dragged = null;
  canvas.addEventListener("pointerdown", (event) => {
    dragged = { x: event.offsetX, min: chart.options.scales.x.min, max: chart.options.scales.x.max };
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!dragged) return;
    const perPixel = (dragged.max - dragged.min) / chart.chartArea.width;
    const moved = (dragged.x - event.offsetX) * perPixel;
    show(dragged.min + moved, dragged.max + moved);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { dragged = null; });
  const reset = () => show(first.min, first.max);
  canvas.addEventListener("dblclick", reset);
  return { stretch: (factor) => stretch(factor, (chart.options.scales.x.min + chart.options.scales.x.max) / 2), reset };
}

function drawWindow(canvas, window_) {
  const kinds = data.bar_kinds.map((label, kind) => ({
    label,
    backgroundColor: barColors[kind],
    // Work and segments are wide; what happens within them lies on top, thinner.
    barPercentage: [0.95, 0.7, 0.4, 0.4, 0.4, 0.25][kind],
    categoryPercentage: 1,
    grouped: false,
    order: -kind,
    minBarLength: 1,
    data: window_.bars.filter((bar) => bar.kind === kind)
      .map((bar) => ({ x: [bar.begin_ms, bar.end_ms], y: window_.rows[bar.row], words: bar.words })),
  })).filter((dataset) => dataset.data.length);
  return draw(canvas, {
    type: "bar",
    data: { labels: window_.rows, datasets: kinds },
    options: {
      indexAxis: "y",
      scales: {
        x: { type: "linear", min: window_.begin_ms, max: window_.end_ms, title: { display: true, text: "ms after its arrival" } },
        y: { ticks: { autoSkip: false } },
      },
      plugins: {
        lines: { at: [{ x: 0, text: "arrival", color: "--soft" }, { x: window_.deadline_ms, text: "deadline" }] },
        tooltip: { callbacks: { title: () => "", label: (item) =>
          `${item.raw.words}: ${number(item.raw.x[0], 3)} to ${number(item.raw.x[1], 3)} ms ` +
          `(${number(item.raw.x[1] - item.raw.x[0], 3)})` } },
      },
    },
  });
}

function storyTable(miss) {
  const table = element("table");
  table.append(row(["from", "to", "ms after its arrival"], "th"));
  table.rows[0].cells[2].className = "left";
  for (const line of miss.story) {
    const what = element("td", line.what, "left");
    what.style.paddingLeft = `${10 + 18 * line.depth}px`;
    table.append(row([number(line.begin_ms, 3), line.end_ms > line.begin_ms ? number(line.end_ms, 3) : "", what]));
  }
  return table;
}

function showMisses() {
  const place = byId("misses");
  const all = runs.flatMap((run) => run.misses.map((miss) => ({ run, miss })));
  if (!all.length) {
    place.append(element("p", "No frame was late.", "soft"));
    return;
  }
  const card = element("div", "", "card"), controls = element("div", "", "controls");
  const choice = element("select");
  choice.ariaLabel = "Missed frame";
  all.forEach(({ run, miss }, i) => {
    const option = element("option", (runs.length > 1 ? `${run.label}: ` : "") + `${miss.name}, ${miss.words}`);
    option.value = i;
    choice.append(option);
  });
  const button = (text, act) => {
    const made = element("button", text);
    made.type = "button";
    made.onclick = act;
    return made;
  };
  let zoom = null, chart = null;
  controls.append(choice, button("+", () => zoom.stretch(0.6)), button("−", () => zoom.stretch(1 / 0.6)),
    button("all", () => zoom.reset()), element("span", "wheel and drag: zoom and move", "soft"));
  const title = element("h3"), sums = element("p", "", "soft"), plot = element("div", "", "plot");
  const details = element("details"), story = element("div");
  details.append(element("summary", "What was done for it"), story);
  card.append(controls, title, sums, plot, details);
  place.append(card);
  const total = runs.reduce((sum, run) => sum + run.chains.reduce((late, chain) => late + chain.late, 0), 0);
  if (total > all.length)
    place.append(element("p", `${all.length} of ${total} late frames are here: of each chain in turn those with the longest latency.`, "soft"));
  const show = () => {
    const { miss } = all[choice.value];
    if (chart) {
      charts.splice(charts.indexOf(chart), 1);
      chart.destroy();
    }
    title.textContent = `${miss.name}: ${miss.words}`;
    const times = (what, list) => (list.length ? `${what} ${list.map((each) => `${each.chain} ${number(each.ms, 3)} ms`).join(", ")}. ` : "");
    sums.textContent = times("Held, in all, behind", miss.held_behind) +
      times("While it was in a GPU segment, in one of theirs were", miss.meanwhile);
    plot.style.height = `${90 + 26 * miss.window.rows.length}px`;
    const canvas = element("canvas");
    plot.replaceChildren(canvas);
    chart = drawWindow(canvas, miss.window);
    zoom = makeZoomable(chart, canvas);
    story.replaceChildren(storyTable(miss));
  };
  choice.onchange = show;
  show();
}
