"""Opens pages of `pslam report` in headless Chromium: no message on the console, every picture drawn, nothing fetched.

usage: browser.py PAGE...
"""

import json
import pathlib
import re
import subprocess
import sys
import tempfile

# Runs in the page after its own script; its answer stands in the DOM that Chromium prints.
PROBE = """
<script>
addEventListener("load", () => {
  const images = [...document.images];
  const plot = document.querySelector("[data-series] svg");
  if (plot) {
    const box = plot.getBoundingClientRect();
    plot.dispatchEvent(new PointerEvent("pointermove", { clientX: box.left + box.width / 2, clientY: box.top + 9 }));
  }
  const found = {
    images: images.length,
    blank: images.filter((image) => !(image.complete && image.naturalWidth > 0)).length,
    unnamed: images.filter((image) => !image.hasAttribute("alt")).length,
    plots: document.querySelectorAll(".plot svg").length,
    empty: [...document.querySelectorAll(".plot svg")].filter((svg) =>
      !svg.querySelector("polyline, polygon, circle") || svg.getBoundingClientRect().height < 50).length,
    unlabelled: [...document.querySelectorAll("svg[role=img]")].filter((svg) => !svg.getAttribute("aria-label")).length,
    odd: (document.querySelector("main").innerText.match(/\\bNaN\\b|undefined/g) || []).length,
    fetched: performance.getEntriesByType("resource").map((entry) => entry.name).filter((name) => !name.startsWith("data:")),
    targets: [...document.querySelectorAll("nav a")].filter((a) => !document.querySelector(a.getAttribute("href"))).length,
    links: document.querySelectorAll("nav a").length,
    wide: document.documentElement.scrollWidth > innerWidth,
    readout: plot ? plot.parentElement.parentElement.querySelector(".readout").textContent : "none",
  };
  document.body.innerHTML = "";
  document.title = "answer " + JSON.stringify(found);
});
</script>
"""


def chromium(page: pathlib.Path, profile: str, width: int) -> subprocess.CompletedProcess:
    return subprocess.run(
        ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", f"--user-data-dir={profile}",
         "--disable-background-networking", "--disable-component-update", "--no-first-run", f"--window-size={width},900",
         "--enable-logging=stderr", "--virtual-time-budget=20000", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, timeout=120)


def check(source: pathlib.Path, width: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        page = pathlib.Path(folder) / "page.html"
        page.write_text(source.read_text().replace("</body>", PROBE + "</body>"))
        ran = chromium(page, folder + "/profile", width)
    messages = [line for line in ran.stderr.splitlines() if "CONSOLE" in line]
    answer = re.search(r"<title>answer (.*?)</title>", ran.stdout, re.S)
    assert answer, f"{source}: no answer from the page\n{ran.stdout[-500:]}\n{ran.stderr[-2000:]}"
    found = json.loads(answer.group(1).replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">"))
    print(f"{source.name} at {width} px: {found}")
    assert not messages, messages
    for wrong in ("blank", "unnamed", "empty", "unlabelled", "odd", "fetched", "targets", "wide"):
        assert not found[wrong], f"{source}: {wrong}"
    assert found["links"] >= 8 and found["plots"] >= 3, f"{source}: too little is drawn"
    assert " s: " in found["readout"], f"{source}: no value below the pointer"


def main() -> None:
    pages = [pathlib.Path(name).resolve() for name in sys.argv[1:]]
    assert pages, __doc__
    for page in pages:
        for width in (1100, 500):
            check(page, width)


main()
