// SPDX-License-Identifier: Apache-2.0
// Draws lines into an SVG anew for every move of a slider: a few milliseconds for a plot, where
// plotly.js takes tens. Colours are classes, so that light and dark need no drawing.
"use strict";
const chart = (() => {
  const left = 52, right = 10, top = 8, bottom = 40;
  const escaped = (text) => String(text).replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);

  function ticksBetween(low, high, count) {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((one) => one * power >= raw);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
      found.push(Number((k * step).toPrecision(12)));
    }
    return found;
  }
  const decades = (low, high) => {
    const found = [];
    for (let k = Math.ceil(Math.log10(low) - 1e-9); 10 ** k <= high * 1.000001; k += 1) {
      found.push(Number((10 ** k).toPrecision(6)));
    }
    return found;
  };

  // The place of a value on an axis of so many pixels, and the values that are labelled.
  function scale(values, from, to, { log, zero, pad, view }) {
    let low = Infinity, high = -Infinity;
    for (const value of view || values) {
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
    if (view) zero = pad = 0;
    if (zero) [low, high] = [Math.min(low, 0), Math.max(high, 0)];
    if (!(low < high)) [low, high] = Number.isFinite(low) ? [low - 0.5, low + 0.5] : [0, 1];
    const room = pad * (high - low);
    if (!log) [low, high] = [low < 0 || !zero ? low - room : low, high > 0 || !zero ? high + room : high];
    const turn = log ? Math.log : (value) => value;
    const factor = (to - from) / (turn(high) - turn(low));
    const offset = from - turn(low) * factor;
    const count = Math.max(2, Math.abs(to - from) / (from > to ? 45 : 75));
    return { at: (value) => turn(value) * factor + offset,
      value: (place) => (log ? Math.exp : (v) => v)((place - offset) / factor),
      ticks: log && high > 10 * low ? decades(low, high) : ticksBetween(low, high, count) };
  }
  function path(line, x, y) {
    let text = "", pen = "M";
    for (let k = 0; k < line.x.length; k += 1) {
      if (line.y[k] === null) { pen = "M"; continue; }
      const h = x.at(line.x[k]).toFixed(1), v = y.at(line.y[k]).toFixed(1);
      text += line.dots ? `M${h} ${v}h0` : `${pen}${h} ${v}`;
      pen = "L";
    }
    return `<path class="${line.dots ? "dots" : "line"} ${line.kind}" d="${text}"/>`;
  }

  // Zoom and pan: what a plot shows of its axes, kept while sliders move. A view belongs to a unit.
  const views = new WeakMap();

  function look(place, spec, x, y) {
    const box = { width: place.clientWidth, height: place.clientHeight };
    const show = (view) => {
      if (view) views.set(place, { ...view, unit: spec.xName });
      else views.delete(place);
      draw(place, spec);
    };
    // The part of the axes between two corners in pixels.
    const between = (x0, x1, y0, y1) =>
      show({ x: [x.value(x0), x.value(x1)], y: [y.value(y1), y.value(y0)] });
    const zoom = (factor, atX, atY) => between(
      atX + (left - atX) * factor, atX + (box.width - right - atX) * factor,
      atY + (top - atY) * factor, atY + (box.height - bottom - atY) * factor);
    const pan = (dx, dy) => between(left + dx, box.width - right + dx,
      top + dy, box.height - bottom + dy);
    place.onwheel = (event) => {
      if (!event.ctrlKey) return;  // the page scrolls otherwise; pinching is a wheel with Ctrl
      event.preventDefault();
      const corner = place.getBoundingClientRect();
      zoom(event.deltaY > 0 ? 1.25 : 0.8, event.clientX - corner.left, event.clientY - corner.top);
    };
    place.onpointerdown = (event) => {
      if (event.button || event.pointerType === "touch") return;
      const from = [event.clientX, event.clientY];
      place.setPointerCapture(event.pointerId);
      place.onpointerup = (end) => {
        place.onpointerup = null;
        const dx = from[0] - end.clientX, dy = from[1] - end.clientY;
        if (Math.hypot(dx, dy) > 3) pan(dx, dy);
      };
    };
    place.ondblclick = () => show(null);
    const step = 0.15 * box.width, middle = [box.width / 2, box.height / 2];
    const keys = { "+": () => zoom(0.8, ...middle), "-": () => zoom(1.25, ...middle),
      0: () => show(null), ArrowLeft: () => pan(-step, 0), ArrowRight: () => pan(step, 0),
      ArrowUp: () => pan(0, -step), ArrowDown: () => pan(0, step) };
    place.onkeydown = (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey || !keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
    };
  }

  function draw(place, spec) {
    const { lines, bands = [], labels = [], xName, yName, log = false, zero = true } = spec;
    const width = place.clientWidth, height = place.clientHeight;
    if (!width || !height) return;
    if (views.get(place)?.unit !== xName) views.delete(place);
    const view = views.get(place) || {};
    const x = scale(lines.flatMap((line) => line.x), left, width - right, { log, pad: 0, view: view.x });
    const y = scale(lines.flatMap((line) => line.y), height - bottom, top, { zero, pad: 0.06, view: view.y });
    look(place, spec, x, y);
    const clip = `${place.id}-clip`;
    const parts = [`<clipPath id="${clip}"><rect x="${left}" y="${top}" ` +
      `width="${width - left - right}" height="${height - top - bottom}"/></clipPath>`];
    parts.push(...bands.map((band) => {
      const from = x.at(band.from);
      return `<rect class="${band.kind}" x="${from.toFixed(1)}" y="${top}" ` +
        `width="${Math.max(0, x.at(band.to) - from).toFixed(1)}" height="${height - top - bottom}" ` +
        `clip-path="url(#${clip})"/>`;
    }));
    for (const tick of x.ticks) {
      const at = x.at(tick).toFixed(1);
      parts.push(`<path class="grid" d="M${at} ${top}V${height - bottom}"/>`,
        `<text x="${at}" y="${height - bottom + 16}" text-anchor="middle">${tick}</text>`);
    }
    for (const tick of y.ticks) {
      const at = y.at(tick).toFixed(1);
      parts.push(`<path class="grid" d="M${left} ${at}H${width - right}"/>`,
        `<text x="${left - 6}" y="${at}" dy=".35em" text-anchor="end">${String(tick).replace("-", "−")}</text>`);
    }
    parts.push(`<path class="frame" d="M${left} ${top}V${height - bottom}H${width - right}"/>`,
      `<g clip-path="url(#${clip})">`, ...lines.map((line) => path(line, x, y)), "</g>");
    for (const label of labels) {
      if (x.at(label.t) < left || x.at(label.t) > width - right) continue;
      parts.push(`<text class="label" x="${x.at(label.t).toFixed(1)}" y="${(y.at(label.x) - 7).toFixed(1)}" ` +
        `text-anchor="middle">${escaped(label.name)}</text>`);
    }
    parts.push(`<text x="${(left + width - right) / 2}" y="${height - 6}" text-anchor="middle">${escaped(xName)}</text>`,
      `<text transform="translate(13 ${(top + height - bottom) / 2}) rotate(-90)" text-anchor="middle">${escaped(yName)}</text>`);
    place.innerHTML = `<svg width="${width}" height="${height}" aria-hidden="true">${parts.join("")}</svg>`;
    place.onpointermove = (event) => {
      const at = x.value(event.clientX - place.getBoundingClientRect().left);
      const near = lines.map((line) => {
        let best = 0;
        for (let k = 1; k < line.x.length; k += 1) {
          if (Math.abs(line.x[k] - at) < Math.abs(line.x[best] - at)) best = k;
        }
        return line.y[best] === null ? "" : `${line.name} ${line.y[best].toPrecision(4)}`;
      });
      place.title = `${xName}: ${Number(at.toPrecision(4))}\n${near.filter(Boolean).join("\n")}`;
    };
  }
  return draw;
})();
