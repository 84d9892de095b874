#!/usr/bin/python3
"""The page of a demo in Chromium: numbers, pictures, faults, hostile viewers, accessibility.

    tests/page/browser_test.py --build build/release [--screenshots DIR] [--faults]

Takes Debian's chromium, chromium-driver and python3-selenium; exits with 77, and says so, where they are not.
Prints what it measures. Times are asserted only where a loaded machine cannot miss them.
"""
import argparse, json, os, re, shutil, signal, statistics, subprocess, sys, tempfile, time
from pathlib import Path

try:
    from selenium import webdriver
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service
except ImportError:
    print("SKIPPED: python3-selenium is not installed (apt-get install chromium chromium-driver python3-selenium)")
    sys.exit(77)
if not (shutil.which("chromium") and shutil.which("chromedriver")):
    print("SKIPPED: chromium is not installed (apt-get install chromium chromium-driver)")
    sys.exit(77)

ROOT = Path(__file__).resolve().parents[2]


def browser(folder, dark, width=1440, height=1500):
    options = Options()
    options.binary_location = shutil.which("chromium")
    for word in ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
                 "--disable-component-update", "--disable-sync", "--hide-scrollbars", f"--user-data-dir={folder}", f"--window-size={width},{height}"]:
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(service=Service(shutil.which("chromedriver")), options=options)
    driver.set_script_timeout(60)
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]})
    return driver


def until(what, met, seconds=30, instead=lambda: ""):
    end = time.time() + seconds
    while time.time() < end:
        if met():
            return
        time.sleep(0.1)
    raise AssertionError(f"within {seconds} s not: {what}\n{instead()}")


def quantile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))] if values else float("nan")


class Demo:
    """./teletact demo --page, its processes those of a build."""

    def __init__(self, build, out, duration, passes):
        environment = dict(os.environ, TELETACT_BUILD_DIR=str(build))
        self.out = Path(out)
        self.log = Path(f"{out}.log")
        self.process = subprocess.Popen([str(ROOT / "teletact"), "demo", "--page", "--out", out, "--duration-s", str(duration), "--passes", str(passes)],
                                        stderr=self.log.open("w"), env=environment, start_new_session=True)

    def says(self, words):
        if self.process.poll() is not None:
            raise AssertionError("the demo ended:\n" + self.log.read_text()[-2000:])
        return words in self.log.read_text()

    def end_touch(self):
        """As Ctrl-C would: the summary is written, and the page stays."""
        for child in Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split():
            if b"\0touch\0" in Path(f"/proc/{child}/cmdline").read_bytes():
                os.kill(int(child), signal.SIGINT)

    def url(self):
        until("an address", lambda: self.says("the page is at"), 300)
        return re.search(r"http://\S+", self.log.read_text()).group(0)

    def end(self):
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(60)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)


# Rules of WCAG 2.1 that can be seen from the document: names, labels, contrast, headings, language, focus.
RULES = r"""
const bad = [];
const luminance = (rgb) => { const l = rgb.map((v) => { v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; }); return 0.2126 * l[0] + 0.7152 * l[1] + 0.0722 * l[2]; };
const parse = (text) => text.match(/[\d.]+/g).map(Number);
const back = (at) => { for (; at; at = at.parentElement) { const c = parse(getComputedStyle(at).backgroundColor); if (c.length < 4 || c[3] > 0) return c; } return [255, 255, 255]; };
if (!document.documentElement.lang) bad.push('no language');
if (!document.title) bad.push('no title');
if (document.querySelectorAll('h1').length !== 1) bad.push('not one h1');
if (document.querySelectorAll('main').length !== 1) bad.push('not one main');
const ids = [...document.querySelectorAll('[id]')].map((e) => e.id);
if (new Set(ids).size !== ids.length) bad.push('an id twice');
for (const e of document.querySelectorAll('button, input, select, canvas, [role=region], [role=toolbar]')) {
  if (!e.offsetParent) continue;
  const name = e.getAttribute('aria-label') || e.textContent.trim() || e.closest('label')?.textContent.trim();
  if (!name) bad.push(`no name: ${e.outerHTML.slice(0, 60)}`);
}
for (const e of document.querySelectorAll('canvas')) if (e.offsetParent && (e.tabIndex < 0 || e.getAttribute('role') !== 'img')) bad.push(`canvas ${e.id}`);
for (const e of document.querySelectorAll('button')) if (e.offsetParent && e.getBoundingClientRect().height < 24) bad.push(`small: ${e.id}`);
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let n = walker.nextNode(); n; n = walker.nextNode()) {
  const e = n.parentElement;
  if (!n.textContent.trim() || !e.offsetParent || e.closest('[aria-hidden=true], .hidden')) continue;
  const f = luminance(parse(getComputedStyle(e).color)), b = luminance(back(e));
  const contrast = (Math.max(f, b) + 0.05) / (Math.min(f, b) + 0.05);
  if (contrast < 4.5) bad.push(`contrast ${contrast.toFixed(2)}: ${n.textContent.trim().slice(0, 30)}`);
}
if (document.documentElement.scrollWidth > innerWidth) bad.push(`wider than the window: ${document.documentElement.scrollWidth} > ${innerWidth}`);
return bad;
"""


def console_errors(driver):
    return [entry["message"] for entry in driver.get_log("browser") if entry["level"] == "SEVERE"]


def not_blank(driver, name):
    return driver.execute_script("""
const c = document.getElementById(arguments[0]); const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
const seen = new Set(); for (let n = 0; n < d.length; n += 4 * 97) seen.add(`${d[n] >> 4},${d[n + 1] >> 4},${d[n + 2] >> 4}`); return seen.size;""", name)


def shot(driver, folder, name, width, height=None):
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {"width": width, "height": height or 900, "deviceScaleFactor": 1, "mobile": width < 600})
    time.sleep(0.8)
    if height is None:
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {"width": width, "height": driver.execute_script("return document.documentElement.scrollHeight"), "deviceScaleFactor": 1, "mobile": width < 600})
        time.sleep(0.8)
    if folder:
        driver.save_screenshot(str(Path(folder) / name))


# What the page has shown since: states of its pill, and lines of its log, each once.
WATCH = """
window.shown = []; window.said = new Set();
const look = () => {
  const state = document.getElementById('state-name').textContent;
  if (shown.at(-1) !== state) shown.push(state);
  for (const line of document.querySelectorAll('#log li')) said.add(`${line.textContent} (${line.dataset.at})`);
  for (const window of document.querySelectorAll('#windows .window')) said.add(`window ${window.textContent}`);
};
new MutationObserver(look).observe(document.querySelector('main'), { subtree: true, childList: true, characterData: true });
"""
RESET = "window.shown = [document.getElementById('state-name').textContent]; window.old = new Set(said);"
NEW_LINES = "return [...said].filter((line) => !old.has(line))"
# The median of the last second's round trips.
ROUND_TRIP = """
const s = teletact.model.series, all = [];
for (let n = s.find(teletact.model.newest - 1); n < s.added; ++n) all.push(s.value(n, s.index.round_trip_s));
return all.sort((a, b) => a - b)[all.length >> 1] ?? 0;"""


def press_faults(driver, demo):
    state = lambda: driver.find_element(By.ID, "state-name").text
    lines = lambda words: [line for line in driver.execute_script(NEW_LINES) if re.search(words, line)]
    trip = lambda: driver.execute_script(ROUND_TRIP)
    paused = lambda: "PAUSED" in driver.execute_script("return shown") and lines("PAUSED: no answer")
    driver.execute_script(WATCH)
    for word, seen in [("decorrelated", lambda: lines("patient side: .*FAILED_PRECONDITION") and lines("not published")),
                       ("force", lambda: lines("doubtful: wrong-force: the modulus is [23]")),
                       ("stall", paused), ("cut", paused), ("jitter", lambda: 0.015 < trip() < 0.15), ("far", lambda: trip() > 0.19),
                       ("none", lambda: trip() < 0.015), ("kill", lambda: paused() and lines("the service was restarted"))]:
        until("ENABLED", lambda: state() == "ENABLED", 60)
        driver.execute_script(RESET)
        driver.find_element(By.CSS_SELECTOR, f"[data-fault={word}]").send_keys(Keys.ENTER)
        until(f"the demo is asked for '{word}'", lambda: demo.says(f"asks for: {word}"), 60, lambda: driver.find_element(By.ID, "where").text)
        begin = time.time()
        until(f"the page shows '{word}'", seen, 60, lambda: "\n".join(driver.execute_script(NEW_LINES)))
        shown_s = time.time() - begin
        until("force again", lambda: state() == "ENABLED" and driver.execute_script("return teletact.model.row.size") > 0.05, 60)
        print(f"[ fault ] {word}: shown after {shown_s:.1f} s ({' '.join(driver.execute_script('return shown'))}), force again after {time.time() - begin:.1f} s; "
              f"round trip {1e3 * trip():.1f} ms", flush=True)


def metrics(driver):
    return {m["name"]: m["value"] for m in driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]}


def look_at_frames(driver, seconds):
    """Processor time of the page's script, by its thread's clock: that of who waits for a processor is none."""
    driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})
    frames = lambda: driver.execute_script("return teletact.measured.frames")
    spans, begin = [], time.time()
    first = last = (frames(), metrics(driver)["ScriptDuration"])
    while time.time() < begin + (seconds if len(spans) > 2 else 60):
        time.sleep(0.2)
        now = (frames(), metrics(driver)["ScriptDuration"])
        if now[0] > last[0]:
            spans.append(1e3 * (now[1] - last[1]) / (now[0] - last[0]))
        last = now
    m = driver.execute_script("return teletact.measured")
    print(f"[ frame ] {(last[0] - first[0]) / (time.time() - begin):.1f} frames/s; script's processor time median {statistics.median(spans):.2f} ms a frame, p95 {quantile(spans, 0.95):.2f} ms "
          f"(means of 0.2 s); by the clock median {statistics.median(m['script_ms']):.2f} ms, p95 {quantile(m['script_ms'], 0.95):.2f} ms; "
          f"pose to pixel median {statistics.median(m['pose_to_pixel_ms']):.1f} ms, p95 {quantile(m['pose_to_pixel_ms'], 0.95):.1f} ms", flush=True)


def hide(driver, seconds):
    """Another tab in front: nothing comes, and afterwards the newest."""
    heap = lambda: (driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {}), metrics(driver)["JSHeapUsedSize"])[1]
    driver.execute_script("""window.seen = [];
document.addEventListener('visibilitychange', () => seen.push([document.visibilityState, teletact.measured.frames, teletact.model.newest]));""")
    page, before = driver.current_window_handle, heap()
    driver.switch_to.new_window("tab")
    time.sleep(seconds)
    driver.close()
    driver.switch_to.window(page)
    driver.execute_cdp_cmd("Page.bringToFront", {})
    until("seen again", lambda: len(driver.execute_script("return seen")) >= 2)
    (hidden, hidden_frames, hidden_s), (_, back_frames, _) = driver.execute_script("return seen")[:2]
    assert hidden == "hidden" and back_frames <= hidden_frames + 1, "a hidden page is sent nothing"
    until("the newest", lambda: driver.execute_script("return teletact.model.newest") >= hidden_s + seconds)
    more = (heap() - before) / 1e6
    print(f"[ hidden ] {seconds:.0f} s: {back_frames - hidden_frames} frames, {more:+.1f} MB of heap, then the newest", flush=True)
    assert more <= 10


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", required=True)
    parser.add_argument("--screenshots")
    parser.add_argument("--faults", action="store_true", help="press every button: a minute more")
    parser.add_argument("--hidden-s", type=float, default=0, help="have another tab in front for so long")
    a = parser.parse_args()
    if a.screenshots:
        os.makedirs(a.screenshots, exist_ok=True)
    folder = tempfile.mkdtemp(prefix="teletact-browser-")
    demo = Demo(a.build, os.path.join(folder, "out"), 600 + a.hidden_s, 61 if a.faults else 13)  # ended when all is seen, however long that takes here
    driver = browser(os.path.join(folder, "profile"), dark=True)
    try:
        url = demo.url()
        until("touching", lambda: demo.says("3/4"), 600)
        time.sleep(2)
        driver.get(url)
        numbers = lambda: driver.execute_script("return window.teletact.measured")
        until("a picture", lambda: numbers()["first_ms"] is not None)
        print(f"[ first ] a map after {numbers()['first_ms']:.0f} ms", flush=True)
        until("ENABLED", lambda: driver.find_element(By.ID, "state-name").text == "ENABLED", 60)
        if a.faults:
            press_faults(driver, demo)
        look_at_frames(driver, 6)
        m = numbers()
        assert m["frames"] > 20
        for name in ["tissue", "close", "force", "ages", "servo"]:
            assert not_blank(driver, name) >= 4, f"{name} is blank"
        for dark in (True, False):
            if (driver.execute_script("return document.documentElement.dataset.theme") == "dark") != dark:
                driver.find_element(By.ID, "theme").click()
            for width in (1440, 390):
                shot(driver, a.screenshots, f"page-{'dark' if dark else 'light'}-{width}.png", width)
                bad = driver.execute_script(RULES)
                assert not bad, (dark, width, bad)
        print("[ rules ] names, contrast, headings and width: none broken, dark and light, 1440 and 390 pixels wide")
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        body = driver.find_element(By.TAG_NAME, "body")
        body.send_keys(Keys.SPACE)
        assert driver.find_element(By.ID, "pause").get_attribute("aria-pressed") == "true"
        for _ in range(4):
            body.send_keys(Keys.ARROW_LEFT)
        assert driver.find_element(By.ID, "scrolled").text == "-2.0 s"
        canvas = driver.find_element(By.ID, "tissue")
        driver.execute_script("arguments[0].focus()", canvas)
        canvas.send_keys(Keys.ARROW_RIGHT)
        assert "x " in driver.find_element(By.ID, "tissue-read").text
        driver.execute_script("document.activeElement.blur()")
        body.send_keys(Keys.SPACE)
        if a.hidden_s:
            hide(driver, a.hidden_s)
        demo.end_touch()
        until("the end", lambda: demo.says("4/4"), 400)
        summary = json.loads((demo.out / "summary.json").read_text())
        until("the last figures", lambda: abs(float(numbers()["numbers"].get("enabled_s", 0)) - summary["enabled_s"]) < 1e-9)
        shown = {k: float(v) for k, v in numbers()["numbers"].items()}
        equal = {"enabled_s": summary["enabled_s"], "touch_rate_hz": summary["touch_rate_hz"], "latency_p50_s": summary["touch_latency_s"]["p50"],
                 "latency_p99_s": summary["touch_latency_s"]["p99"], "by_law_share": summary["by_law_share"], "stalls": summary["stalls"]["count"],
                 "largest_force_n": summary["largest_force_n"], "rate_hz": summary["servo"]["rate_hz"], "overruns": summary["servo"]["overruns"],
                 "lateness_p99_s": summary["servo"]["lateness_s_p99"], "answers": summary["link"]["answers"], "streams": summary["link"]["streams"],
                 "lost_s": summary["lost_s"], "round_trip_p50_s": summary["link"]["round_trip_s"]["p50"]}
        for name, value in equal.items():
            assert abs(shown[name] - value) <= 1e-9 * max(1, abs(value)), (name, shown[name], value)
        print(f"[ equal ] {len(equal)} figures of the page are the summary's")
        until("what stands there being called old", lambda: driver.find_element(By.ID, "state-name").text == "OLD", 10)
        assert "ended" in driver.find_element(By.ID, "state-reason").text
        errors = console_errors(driver)
        assert not errors, errors
        print("[ quiet ] no error in the console")
    finally:
        driver.quit()
        demo.end()
        shutil.rmtree(folder, ignore_errors=True)


main()
