#!/usr/bin/env python3
"""The dashboard against a real Prometheus, which scrapes a service under load as packaging/prometheus has it.

    tests/packaging/prometheus_test.py --build build/release

Each of the dashboard's queries is asked, of one instant and over the whole time, and has to give numbers, under the
labels that its legend names. Takes Debian's prometheus; exits with 77, and says so, where it is not.
"""
import argparse, json, math, re, shutil, signal, socket, subprocess, sys, tempfile, time, urllib.error, urllib.parse, urllib.request
from pathlib import Path

if not shutil.which("prometheus"):
    print("SKIPPED: prometheus is not installed (apt-get install --no-install-recommends prometheus)")
    sys.exit(77)

PACKAGED = Path(__file__).resolve().parents[2] / "packaging/prometheus"
LOAD_S = 20


def until(what, met, seconds=120):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        found = met()
        if found:
            return found
        time.sleep(0.1)
    raise AssertionError(f"within {seconds} s not: {what}")


class Process:
    """Ends with the block that it is for."""

    def __init__(self, log, *words):
        self.log = log
        self.process = subprocess.Popen([str(word) for word in words], stdout=log.open("w"), stderr=subprocess.STDOUT)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def says(self, pattern):
        assert self.process.poll() is None, "it ended:\n" + self.log.read_text()
        return re.search(pattern, self.log.read_text())


def free_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


class Refused(Exception):
    """By Prometheus, in its own words."""


class Prometheus:
    """Its HTTP API."""

    def __init__(self, address):
        self.url = f"http://{address}/api/v1/"

    def ask(self, what, **asked):
        try:
            with urllib.request.urlopen(f"{self.url}{what}?{urllib.parse.urlencode(asked)}", timeout=30) as answer:
                return json.load(answer)["data"]
        except urllib.error.HTTPError as error:
            if error.code == 503:  # it does not serve yet
                return None
            raise Refused(json.load(error)["error"]) from error
        except OSError:
            return None  # nor listens


def replaced(text, pattern, by):
    out, times = re.subn(pattern, by, text)
    assert times == 1, f"{pattern} stands {times} times in it"
    return out


def configuration(admin):
    """The packaged one, of this service, and in a hurry."""
    text = (PACKAGED / "prometheus.yml").read_text()
    return replaced(replaced(text, r"targets: \[.*\]", f'targets: ["{admin}"]'), r"scrape_interval: \w+", "scrape_interval: 500ms")


def queries(dashboard):
    for panel in dashboard["panels"]:
        for target in panel["targets"]:
            yield panel["title"], target["expr"], target.get("legendFormat", "")


def is_number(value):
    return math.isfinite(float(value))


def check(prometheus, title, expression, legend, begin, end):
    """What is wrong with it, or nothing."""
    try:
        now = prometheus.ask("query", query=expression)["result"]
        course = prometheus.ask("query_range", query=expression, start=begin, end=end, step=1)["result"]
    except Refused as error:
        return f"is refused: {error}"
    if not any(is_number(series["value"][1]) for series in now):
        return "gives no number now"
    if not any(is_number(value) for series in course for _, value in series["values"]):
        return "gives no number over the time"
    for label in re.findall(r"{{\s*(\w+)\s*}}", legend):
        if not all(label in series["metric"] for series in now):
            return f"gives no label {label}, which its legend {legend} names"
    return ""


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--build", type=Path, required=True, help="folder of the build")
    build = options.parse_args().build
    dashboard = json.loads((PACKAGED / "dashboard.json").read_text())
    variables = {one["name"]: one for one in dashboard["templating"]["list"]}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with Process(folder / "service.log", build / "service/teletact-service", "serve", "--listen", f"unix:{folder}/s", "--admin", "127.0.0.1:0") as service:
            admin = until("a service", lambda: service.says(r"metrics and health on (\S+)"), 600).group(1)
            (folder / "prometheus.yml").write_text(configuration(admin))
            listen = f"127.0.0.1:{free_port()}"
            with Process(folder / "prometheus.log", shutil.which("prometheus"), f"--config.file={folder}/prometheus.yml", f"--storage.tsdb.path={folder}/data",
                         f"--web.listen-address={listen}") as server:
                prometheus = Prometheus(listen)
                begin = time.time()
                up = lambda: server.says("") and (prometheus.ask("query", query='up{job="teletact"}') or {}).get("result")
                assert until("a scrape", up)[0]["value"][1] == "1", prometheus.ask("targets")
                with Process(folder / "load.log", build / "bench/teletact-bench", "load", "--service", f"unix:{folder}/s", "--clients", 4, "--rate-hz", 50,
                             "--laws", "--imaging", 1, "--image-every-s", 1, "--stay-s", 5, "--duration-s", LOAD_S) as load:
                    until("estimates", lambda: any(is_number(one["value"][1]) and float(one["value"][1]) >= 3 for one in prometheus.ask(
                        "query", query='teletact_estimate_stage_seconds_count{stage="publish"}')["result"]), 300)
                    # What the dashboard's variables offer.
                    label = re.fullmatch(r"label_values\((\w+), (\w+)\)", variables["instance"]["query"]["query"])
                    offered = prometheus.ask(f"label/{label.group(2)}/values", **{"match[]": label.group(1)})
                    assert offered == [admin], f"{variables['instance']['query']['query']} offers {offered}, not {[admin]}"
                    until("the load's end", lambda: load.process.poll() is not None, 300)
                faults, asked = [], 0
                for title, expression, legend in queries(dashboard):
                    for chosen in (variables["instance"]["allValue"], re.escape(admin)):
                        query = expression.replace("$instance", chosen.replace("\\", "\\\\"))
                        assert "$" not in query, f"{title}: a variable that is not known here: {query}"
                        asked += 1
                        fault = check(prometheus, title, query, legend, begin, time.time())
                        if fault:
                            faults.append(f"{title}: {query} {fault}")
                version = prometheus.ask("status/buildinfo")["version"]
                assert not faults, "\n".join(faults)
                linted = subprocess.run(["promtool", "check", "metrics"], input=urllib.request.urlopen(f"http://{admin}/metrics").read(), capture_output=True)
                assert linted.returncode == 0, f"promtool check metrics: {linted.stdout.decode()}{linted.stderr.decode()}"
                print(f"{asked} queries of {len(dashboard['panels'])} panels give numbers, Prometheus {version}")


if __name__ == "__main__":
    main()
