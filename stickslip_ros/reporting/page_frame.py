# SPDX-License-Identifier: Apache-2.0
"""The frame of the report page: structure, looks, and how it draws. Parts go in at @NAME@."""

FRAME = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'
 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:">
<title>@TITLE@</title>
<link rel="icon" href="data:,">
<style>
:root { --ink: #1c2430; --soft: #5d6878; --line: #dde2e9; --bad: #b3261e; --good: #1e6b3a; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 20px; max-width: 1120px; color: var(--ink); background: #fff;
  font: 15px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
header { border-bottom: 2px solid var(--ink); padding-bottom: 10px; margin-bottom: 18px; }
h1 { font-size: 24px; margin: 0 0 6px; }
h2 { font-size: 17px; margin: 26px 0 8px; }
.sub { color: var(--soft); overflow-wrap: anywhere; }
.sub b { color: var(--ink); }
.badge { display: inline-block; margin-top: 8px; padding: 3px 12px; border-radius: 12px;
  font-weight: 600; font-size: 14px; print-color-adjust: exact; -webkit-print-color-adjust: exact; }
.badge.good { background: #dff2e5; color: var(--good); }
.badge.bad { background: #fbe3e1; color: var(--bad); }
.badge.plain { background: #edf0f4; color: var(--soft); }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 10px; }
.card { border: 1px solid var(--line); border-radius: 8px; padding: 10px 12px; }
.card .what, .card .more { color: var(--soft); font-size: 13px; }
.card .value { font-size: 21px; font-weight: 600; white-space: nowrap; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: 5px 10px; border-bottom: 1px solid var(--line); text-align: left; }
thead th { color: var(--soft); font-weight: 500; font-size: 13px; }
tbody th { font-weight: 500; }
.number { text-align: right; white-space: nowrap; }
tr.differs td:last-child { color: var(--bad); font-weight: 600; }
tr.same td:last-child { color: var(--good); }
.plot { width: 100%; min-height: 300px; }
.pairs { display: grid; grid-template-columns: repeat(auto-fill, minmax(215px, 1fr));
  gap: 0 22px; margin: 0; font-size: 13.5px; }
.pairs div { display: flex; justify-content: space-between; gap: 10px; padding: 3px 0;
  border-bottom: 1px solid var(--line); }
.pairs dt { color: var(--soft); }
.pairs dd { margin: 0; text-align: right; overflow-wrap: anywhere; }
summary { cursor: pointer; font-weight: 600; padding: 8px 0; }
ul { padding-left: 20px; }
code { font-size: 13px; overflow-wrap: anywhere; }
.hint, footer { color: var(--soft); font-size: 13px; }
@media (max-width: 600px) {
  body { padding: 12px; }
  h1 { font-size: 20px; }
  .cards { grid-template-columns: 1fr 1fr; }
  .card .value { font-size: 18px; }
  th, td { padding: 4px 4px; font-size: 12.5px; }
  .wide { display: none; }
}
@page { size: A4; margin: 13mm; }
@media print {
  body { padding: 0; max-width: none; font-size: 11pt; }
  .hint, .modebar, details:not([open]) { display: none !important; }
  section.figure, .card, tr { break-inside: avoid; }
  h2 { break-after: avoid; }
}
</style>
</head>
<body>
<header>
<h1>Run and measurement compared</h1>
<div class="sub">run <b>@RUN@</b> · measurement <b>@MEASUREMENT@</b></div>
@VERDICT@
</header>
<div class="cards">@CARDS@</div>
<section>
<h2>Metrics</h2>
<p>@DIFFERING@</p>
<div class="scroll"><table>
<thead><tr><th>metric</th><th class="number">run</th><th class="number">measured</th>
<th class="number">difference</th><th class="number wide">tolerance</th><th></th></tr></thead>
<tbody>@METRICS@</tbody>
</table></div>
</section>
@LIMITS@
<p class="hint">Plots: drag to zoom, double-click to see all, click on a name to hide its line.</p>
<p id="trouble" role="alert" hidden></p>
<noscript><p>The plots need JavaScript; the numbers above do not.</p></noscript>
@PLOTS@
@CYCLES@
<section><h2>How they were compared</h2><ul>@NOTES@</ul></section>
<section><h2>Parameters of the run at its start</h2>@PARAMETERS@</section>
<section><h2>Versions</h2>@VERSIONS@</section>
<footer><p>Made by <code>@COMMAND@</code></p></footer>
<script type="application/json" id="data">@DATA@</script>
<script type="text/plain" id="library">@LIBRARY@</script>
<script>
"use strict";
(async () => {
  const text = (id) => document.getElementById(id).textContent;
  const packed = Uint8Array.from(atob(text("library")), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const library = document.createElement("script");
  library.textContent = await new Response(stream).text();
  document.head.append(library);

  const figures = JSON.parse(text("data"));
  const narrow = () => window.innerWidth < 600;
  const common = {
    font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: "#1c2430" },
    paper_bgcolor: "white", plot_bgcolor: "white",
  };
  const axis = { gridcolor: "#e6eaef", linecolor: "#9aa4b2", showline: true, zeroline: false };
  const config = { responsive: true, displaylogo: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"] };
  for (const [id, figure] of Object.entries(figures)) {
    const layout = { ...common, ...figure.layout };
    for (const name of Object.keys(layout)) {
      if (/^[xy]axis/.test(name)) layout[name] = { ...axis, ...layout[name] };
    }
    if (narrow()) {
      layout.margin = { ...layout.margin, l: 46, r: 6, t: 70 };
      layout.dragmode = false;
      layout.height += 16 * figure.data.length;  // names stand below each other
    }
    const shown = narrow() ? { ...config, displayModeBar: false } : config;
    await Plotly.newPlot(id, figure.data, layout, shown);
  }
  // Paper is narrower than most windows.
  const plots = () => document.querySelectorAll(".plot");
  window.addEventListener("beforeprint", () => {
    for (const plot of plots()) Plotly.relayout(plot, { width: 690, autosize: false });
  });
  window.addEventListener("afterprint", () => {
    for (const plot of plots()) Plotly.relayout(plot, { width: null, autosize: true });
  });
  document.body.dataset.drawn = "yes";
})().catch((error) => {
  const trouble = document.getElementById("trouble");
  trouble.hidden = false;
  trouble.textContent =
    `The plots could not be drawn (${error.message}); a browser of 2023 or later can.`;
});
</script>
</body>
</html>
"""
