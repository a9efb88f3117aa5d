// Values below the pointer; the page is whole without.
for (const plot of document.querySelectorAll("[data-series]")) {
  const series = JSON.parse(plot.dataset.series), svg = plot.querySelector("svg");
  const [left, right, end] = plot.dataset.range.split(",").map(Number);
  const readout = plot.parentElement.querySelector(".readout");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  for (const [name, value] of [["y1", 0], ["y2", "100%"], ["stroke", "currentColor"], ["stroke-opacity", ".4"]]) {
    line.setAttribute(name, value);
  }
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
    const share = (x - left) / (right - left);
    if (share < 0 || share > 1) return;
    const text = series.map(({ name, unit, values }) => {
      const value = values[Math.min(values.length - 1, Math.floor(share * values.length))];
      return value === null ? `${name} none` : `${name} ${value}${unit}`;
    });
    readout.textContent = `${(share * end).toFixed(2)} s: ${text.join(", ")}`;
    line.setAttribute("x1", x);
    line.setAttribute("x2", x);
    svg.append(line);
  });
  svg.addEventListener("pointerleave", () => { line.remove(); readout.textContent = ""; });
}
