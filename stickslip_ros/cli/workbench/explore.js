// SPDX-License-Identifier: Apache-2.0
// The page of `stickslip explore`: sends what the sliders say, draws what comes back.
"use strict";
(() => {
  const element = (id) => document.getElementById(id);
  const controls = [...document.querySelectorAll(".control[data-name]")].map(controlOf);
  const selects = [...document.querySelectorAll("select[data-name]")];
  const changes = new Map();  // name: text in SI units, "" for the law's own value
  let last = null, asking = false, stale = false, asked = 0;

  // -- sliders

  function controlOf(box) {
    const data = box.dataset;
    const control = { box, name: data.name, unit: data.unit, factor: Number(data.factor),
      low: Number(data.low), high: Number(data.high), log: data.log === "1", own: data.own === "1",
      isSet: data.set === "1", range: box.querySelector("input[type=range]"),
      number: box.querySelector("input[type=number]"), button: box.querySelector("button.own") };
    const value = Number(data.value);
    if (value > control.high) control.high = value;
    if (value < control.low && (value > 0 || !control.log)) control.low = value;
    show(control, value);
    control.range.addEventListener("input", () => {
      const at = valueAt(control, Number(control.range.value));
      control.number.value = at;
      set(control, at);
    });
    control.number.addEventListener("input", () => {
      const at = control.number.valueAsNumber;
      if (!Number.isFinite(at)) return;
      control.range.value = placeOf(control, at);
      set(control, at);
    });
    if (control.button) control.button.addEventListener("click", () => {
      control.isSet = false;
      changes.set(control.name, "");
      mark(control);
      control.range.focus();
      ask();
    });
    return control;
  }
  function valueAt({ low, high, log }, place) {
    const part = place / 400;
    const value = log ? low * (high / low) ** part : low + (high - low) * part;
    return Number(value.toPrecision(3));
  }
  function placeOf({ low, high, log }, value) {
    const part = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    return Math.round(400 * Math.min(1, Math.max(0, Number.isFinite(part) ? part : 0)));
  }
  function show(control, value) {
    control.number.value = value;
    control.range.value = placeOf(control, value);
    mark(control);
  }
  function mark(control) {
    const unset = control.own && !control.isSet;
    control.box.classList.toggle("unset", unset);
    if (control.button) control.button.disabled = unset;
    const text = `${control.number.value} ${control.unit}${unset ? ", the law's own value" : ""}`;
    control.range.setAttribute("aria-valuetext", text);
  }
  function set(control, value) {
    control.isSet = true;
    // Fifteen digits: 0.3 * 1e-9 and the like leave a trace in the last.
    changes.set(control.name, String(Number((value * control.factor).toPrecision(15))));
    mark(control);
    ask();
  }
  for (const select of selects) {
    select.addEventListener("change", () => {
      changes.set(select.dataset.name, select.value);
      ask();
    });
  }

  // -- the link: its part behind # says what was changed, so it can be kept and passed on

  function keep() {
    const text = new URLSearchParams([...changes]).toString();
    window.history.replaceState(null, "", text ? `#${text}` : window.location.pathname);
  }
  function restore() {
    for (const [name, text] of new URLSearchParams(window.location.hash.slice(1))) {
      const control = controls.find((one) => one.name === name);
      const select = selects.find((one) => one.dataset.name === name);
      changes.set(name, text);
      if (select) select.value = text;
      if (control && text !== "" && Number.isFinite(Number(text))) {
        control.isSet = true;
        show(control, Number((Number(text) / control.factor).toPrecision(12)));
      }
    }
  }
  element("reset").addEventListener("click", () => {
    changes.clear();
    keep();
    window.location.reload();
  });

  // -- asking: one question at a time, always the latest

  async function ask() {
    stale = true;
    keep();
    if (asking) return;
    asking = true;
    while (stale) {
      stale = false;
      asked = performance.now();
      const patience = setTimeout(() => say("The first answer takes a while where the solver has " +
        "to be compiled, once for this version."), 1500);
      try {
        const answer = await (await fetch(`/curves?${new URLSearchParams([...changes])}`)).json();
        if (answer.error) {
          complain(answer.error);
        } else {
          complain("");
          last = answer;
          draw();
          await new Promise(requestAnimationFrame);
          measure();
        }
      } catch (error) {
        complain(`No answer from stickslip explore (${error.message}); is it still running?`);
      } finally {
        clearTimeout(patience);
      }
    }
    asking = false;
    if (last) say(Object.entries(last.numbers).map(([k, v]) => `${k} ${v}`).join(", "));
  }
  function measure() {  // how long slider to curve takes: window.stickslipTimes, for the tests
    const took = performance.now() - asked;
    (window.stickslipTimes ||= []).push(took);
    document.body.dataset.drawn = String(Number(document.body.dataset.drawn || 0) + 1);
  }
  function say(text) { element("news").textContent = text; }
  function complain(text) {
    const place = element("trouble");
    place.hidden = !text;
    if (place.textContent !== text) place.textContent = text;
  }

  // -- drawing

  const kinds = { "presliding 1": "presliding", stick: "stick", "slowdown 2": "slowdown" };
  const units = { preload: "preload (N)", amplitude: "amplitude (V)", frequency: "frequency (Hz)" };

  function draw() {
    for (const name of ["step", "slip"]) {
      const { t, x, u, unit, phases, points, measured } = last[name];
      if (measured) element("measured-key").hidden = element("fitting").hidden = false;
      const lines = [{ x: t, y: u, name: "actuator", kind: "actuator" },
        { x: t, y: x, name: "runner", kind: "runner" }];
      if (measured) {
        lines.splice(1, 0, { x: measured.t, y: measured.x, name: "measured", kind: "measured",
          dots: true });
      }
      const bands = phases.map((one) => ({ ...one, kind: `band ${kinds[one.name] || "slips"}` }));
      chart(element(name), { lines, bands, labels: points, xName: `time (${unit})`,
        yName: "displacement (nm)", zero: name === "step" });
    }
    for (const [name, curve] of Object.entries(last.over)) {
      chart(element(`over-${name}`), { xName: units[name], yName: "step (nm)",
        log: name !== "amplitude",
        lines: [{ x: curve.x, y: curve.y, name: "step", kind: "runner" },
          { x: [curve.now[0]], y: [curve.now[1]], name: "now", kind: "now", dots: true }] });
    }
    describe();
  }
  // -- pictures and data of a plot

  const titles = () => element("which").selectedOptions[0];
  function download(content, kind, end) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type: kind }));
    link.download = `stickslip-${element("which").value}.${end}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    element("copied").textContent = `${titles().textContent}: ${link.download}`;
  }
  // The drawing with its colours written into it: a file has no style sheet of the page.
  function picture() {
    const drawn = element(element("which").value).querySelector("svg"), copy = drawn.cloneNode(true);
    const from = [...drawn.querySelectorAll("*")], to = [...copy.querySelectorAll("*")];
    from.forEach((one, k) => {
      const style = getComputedStyle(one);
      for (const name of ["fill", "stroke", "stroke-width", "font-size", "font-family", "font-weight"]) {
        to[k].style.setProperty(name, style.getPropertyValue(name));
      }
    });
    copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    copy.style.background = getComputedStyle(document.body).backgroundColor;
    return { text: new XMLSerializer().serializeToString(copy), width: drawn.clientWidth,
      height: drawn.clientHeight };
  }
  function table() {
    const name = element("which").value, over = last.over[name.replace("over-", "")];
    const columns = over
      ? { [units[name.replace("over-", "")]]: over.x, "step (nm)": over.y }
      : { [`time (${last[name].unit})`]: last[name].t, "runner (nm)": last[name].x,
        "actuator (nm)": last[name].u };
    const rows = Object.values(columns)[0].map((_, k) =>
      Object.values(columns).map((one) => one[k] ?? "").join(","));
    return [Object.keys(columns).join(","), ...rows, ""].join("\n");
  }
  const savers = {
    SVG: () => download(picture().text, "image/svg+xml", "svg"),
    PNG: () => {
      const { text, width, height } = picture(), image = new Image();
      image.onload = () => {
        const canvas = Object.assign(document.createElement("canvas"), { width: 3 * width, height: 3 * height });
        canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
        canvas.toBlob((blob) => download(blob, "image/png", "png"));
      };
      image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
    },
    CSV: () => download(table(), "text/csv", "csv"),
  };
  for (const button of document.querySelectorAll("button.save")) {
    button.addEventListener("click", () => last && savers[button.dataset.kind]());
  }

  const least = (values) => Math.min(...values).toFixed(1);
  const most = (values) => Math.max(...values).toFixed(1);
  function describe() {
    element("left-out").hidden = !last.left_out.length;
    element("left-out").textContent = `The drawn step is without ${last.left_out.join(", ")}.`;
    const cards = element("numbers");
    const wanted = Object.entries(last.numbers);
    if (cards.children.length !== wanted.length) {
      cards.replaceChildren(...wanted.map(() => {
        const card = document.createElement("div");
        card.className = "card";
        for (const part of ["what", "value"]) {
          card.append(Object.assign(document.createElement("div"), { className: part }));
        }
        return card;
      }));
    }
    wanted.forEach(([what, value], k) => {
      cards.children[k].children[0].textContent = what;
      cards.children[k].children[1].textContent = value;
    });
    for (const name of ["step", "slip"]) {
      const { t, x, u, unit, phases } = last[name];
      const spans = phases.map((one) => `${one.name} until ${one.to.toPrecision(4)} ${unit}`);
      element(`${name}-text`).textContent = `From ${t[0]} to ${t.at(-1)} ${unit}. The actuator ` +
        `moves between ${least(u)} and ${most(u)} nm, the runner between ${least(x)} and ` +
        `${most(x)} nm. Phases: ${spans.join(", ")}.`;
    }
    for (const [name, curve] of Object.entries(last.over)) {
      const known = curve.y.filter((y) => y !== null);
      element(`${name}-text`).textContent = known.length
        ? `From ${curve.x[0]} to ${curve.x.at(-1)}: steps between ${least(known)} and ` +
          `${most(known)} nm.` : "No value is possible.";
    }
    const own = new Set(last.set);
    for (const control of controls) {
      if (control.own) control.isSet = own.has(control.name);
      if (control.own && !control.isSet) show(control, last.values[control.name]);
      mark(control);
    }
  }
  new ResizeObserver(() => last && draw()).observe(element("step"));

  // -- copies and files

  for (const button of document.querySelectorAll("button.copy")) {
    button.addEventListener("click", async () => {
      if (!last) return;
      const kind = button.dataset.kind, place = element("text");
      place.value = last.copy[kind];
      place.hidden = false;
      try {
        await navigator.clipboard.writeText(place.value);
        element("copied").textContent = `${kind} copied`;
      } catch {
        place.select();
        element("copied").textContent = `${kind} below: press Ctrl-C`;
      }
    });
  }
  for (const input of document.querySelectorAll("input.file")) {
    input.addEventListener("change", async () => {
      const file = input.files[0];
      if (!file) return;
      const how = [...document.querySelectorAll("input.how")].filter((one) => one.value.trim())
        .map((one) => [one.dataset.name, one.value.trim()]);
      const address = `/open?${new URLSearchParams([["name", file.name], ...how])}`;
      input.value = "";  // the same file may be chosen again, after a field was filled in
      try {
        const answer = await (await fetch(address, { method: "POST", body: file })).json();
        if (answer.error) return complain(answer.error);
        if (answer.parameters) return window.location.reload();
        const control = controls.find((one) => one.name === "frequency");
        show(control, answer.frequency);
        set(control, answer.frequency);
      } catch (error) {
        complain(`${file.name} could not be sent (${error.message})`);
      }
    });
  }

  // -- the fit: started here, done by the server, watched until it ends

  async function send(address) {
    const answer = await (await fetch(address, { method: "POST" })).json();
    if (answer.error) complain(answer.error);
    return answer;
  }
  async function watch() {
    for (;;) {
      const { state, stage, part, values, report, misfit, error } = await (await fetch("/fit")).json();
      const running = state === "running";
      element("fit").disabled = running;
      for (const name of ["cancel", "part"]) element(name).hidden = !running;
      if (running) {
        element("part").value = part;
        const best = Object.entries(values).map(([name, value]) => `${name} ${value.toPrecision(4)}`);
        element("stage").textContent = [stage, ...best].join(", ");
        await new Promise((done) => setTimeout(done, 300));
        continue;
      }
      element("stage").textContent = error || (misfit ? `misfit: ${misfit}` : "");
      element("report").hidden = !report;
      element("report").textContent = report || "";
      return state;
    }
  }
  element("fit").addEventListener("click", async () => {
    const answer = await send(`/fit?${new URLSearchParams([...changes])}`);
    if (answer.error) return;
    if (await watch() === "failed") return;
    changes.clear();  // the fit began from them; what it found is the server's new start
    keep();
    window.location.reload();
  });
  element("cancel").addEventListener("click", () => send("/cancel"));

  restore();
  watch();
  ask();
})();
