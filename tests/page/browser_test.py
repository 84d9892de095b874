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


def until(what, met, seconds=30):
    end = time.time() + seconds
    while time.time() < end:
        if met():
            return
        time.sleep(0.1)
    raise AssertionError(f"within {seconds} s not: {what}")


def quantile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))] if values else float("nan")


class Demo:
    """./teletact demo --page, its processes those of a build."""

    def __init__(self, build, out, duration, passes):
        environment = dict(os.environ, TELETACT_BUILD_DIR=str(build))
        self.out = Path(out)
        self.process = subprocess.Popen([str(ROOT / "teletact"), "demo", "--page", "--out", out, "--duration-s", str(duration), "--passes", str(passes)],
                                        stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True)
        self.lines = []
        os.set_blocking(self.process.stderr.fileno(), False)

    def says(self, words):
        for line in iter(self.process.stderr.readline, ""):
            self.lines.append(line)
        if self.process.poll() is not None:
            raise AssertionError("the demo ended: " + "".join(self.lines[-20:]))
        return any(words in line for line in self.lines)

    def url(self):
        until("an address", lambda: self.says("the page is at"), 300)
        return re.search(r"http://\S+", "".join(self.lines)).group(0)

    def end(self):
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(30)
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


def press_faults(driver, folder, out):
    # Of the patient side: pairs that could not be tracked, and what is doubted of windows.
    log_of = lambda name: len(re.findall("track|doubtful", (out / "log" / f"{name}.log").read_text()))
    state = lambda: driver.find_element(By.ID, "state-name").text
    figures = lambda: driver.execute_script("return window.teletact.measured.numbers")
    press = lambda word: driver.find_element(By.CSS_SELECTOR, f"[data-fault={word}]").click()
    windows = lambda: driver.find_element(By.ID, "windows").text
    round_trip = lambda: driver.execute_script("return window.teletact.model.row.at('round_trip_s')")
    enabled = lambda: until("ENABLED", lambda: state() == "ENABLED", 60)
    enabled()
    before = {}
    for word, seen in [("decorrelated", lambda: log_of("acquire") > before["acquire"]), ("force", lambda: "wrong-force" in windows() or "pressure" in windows()),
                       ("stall", lambda: state() in ("PAUSED", "DEGRADED")), ("cut", lambda: state() in ("PAUSED", "DEGRADED")),
                       ("far", lambda: round_trip() > 0.1), ("jitter", lambda: 0.01 < round_trip() < 0.1), ("none", lambda: round_trip() < 0.01),
                       ("kill", lambda: state() == "PAUSED")]:
        before["acquire"] = log_of("acquire")
        press(word)
        begin = time.time()
        until(f"the page shows '{word}'", seen, 60)
        print(f"[ fault ] {word}: {state()}, {driver.find_element(By.ID, 'state-reason').text!r} after {time.time() - begin:.1f} s", flush=True)
        if folder and word in ("cut", "kill"):
            shot(driver, folder, f"page-{word}.png", 1280, 800)
        enabled()
    assert int(figures()["streams"]) >= 3, figures()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", required=True)
    parser.add_argument("--screenshots")
    parser.add_argument("--faults", action="store_true", help="press every button: a minute more")
    parser.add_argument("--duration-s", type=float, default=20)
    a = parser.parse_args()
    if a.screenshots:
        os.makedirs(a.screenshots, exist_ok=True)
    folder = tempfile.mkdtemp(prefix="teletact-browser-")
    demo = Demo(a.build, os.path.join(folder, "out"), 150 if a.faults else a.duration_s, 16 if a.faults else 13)
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
        time.sleep(6)
        m = numbers()
        print(f"[ frame ] {m['frames']} frames; script median {statistics.median(m['script_ms']):.2f} ms, p95 {quantile(m['script_ms'], 0.95):.2f} ms; "
              f"pose to pixel median {statistics.median(m['pose_to_pixel_ms']):.1f} ms, p95 {quantile(m['pose_to_pixel_ms'], 0.95):.1f} ms", flush=True)
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
        if a.faults:
            press_faults(driver, a.screenshots, demo.out)
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
        errors = console_errors(driver)
        assert not errors, errors
        print("[ quiet ] no error in the console")
    finally:
        driver.quit()
        demo.end()
        shutil.rmtree(folder, ignore_errors=True)


main()
