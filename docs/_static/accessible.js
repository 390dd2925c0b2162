// SPDX-License-Identifier: Apache-2.0
// What the theme leaves out: wide tables and code scroll with the keyboard, headings of the
// navigation have a level, its two copies have names, and a drawing is named by its heading.
"use strict";
for (const wide of document.querySelectorAll("pre, .table-wrapper, div.math")) {
  if (wide.scrollWidth > wide.clientWidth) wide.tabIndex = 0;
}
for (const caption of document.querySelectorAll("p.caption[role=heading]")) {
  caption.setAttribute("aria-level", "2");
}
document.querySelector("aside.sidebar-drawer")?.setAttribute("aria-label", "pages");
document.querySelector("aside.toc-drawer")?.setAttribute("aria-label", "on this page");
for (const drawing of document.querySelectorAll("object")) {
  const heading = drawing.closest("section")?.querySelector("h1, h2, h3")?.firstChild;
  drawing.setAttribute("aria-label", `drawing: ${heading?.textContent || document.title}`);
}
