// teletact-bench patients: `./teletact demo` on solid patients that differ where tissue does: forces,
// intervals and lumps beside each one's own tissue, and how soon its slices come.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>

#include "bench/run_suite.h"
#include "client/patient/tissue.h"

namespace teletact::bench {
namespace {

namespace fs = std::filesystem;
using client::Solid;
using client::Support;
using client::Tissue;
using nlohmann::json;

struct Case {
  const char* row;
  std::uint64_t seed;
  std::function<void(Solid&)> change;
  const char* surface = "unknown";  // as it is stated
};

// Ten patients of whose surface nothing is stated; then what stating it makes of some.
const std::vector<Case>& cases() {
  const auto none = [](Solid&) {};
  const auto texture = [](Solid& s) { s.texture = 0.12; };
  const auto capsule = [](double thickness_m, double contrast) {
    return [=](Solid& s) { s.capsule_m = thickness_m, s.capsule_contrast = contrast; };
  };
  static const std::vector<Case> all = {
      {"plain", 1, none},
      {"texture of 12 %", 2, texture},
      {"sliding support", 3, [](Solid& s) { s.support = Support::kSliding; }},
      {"capsule of 1 mm, 3 times", 4, capsule(0.001, 3)},
      {"capsule of 2 mm, 2 times", 5, capsule(0.002, 2)},
      {"capsule of 0.5 mm, 5 times", 6, capsule(0.0005, 5)},
      {"film of 1 mm, 0.4 times", 7, capsule(0.001, 0.4)},
      {"1.6 times stiffer to the bottom", 8, [](Solid& s) { s.bottom_contrast = 1.6; }},
      {"bed of 10 mm, 2 kPa", 9, [](Solid& s) { s.support = Support::kBed; }},
      {"friction of 0.3", 10, [](Solid& s) { s.friction = 0.3; }},
      {"plain, stated as bare", 1, none, "bare"},
      {"capsule of 1 mm, 3 times, stated as bare", 4, capsule(0.001, 3), "bare"},
      {"texture of 12 %, stated as uneven", 2, texture, "uneven"},
  };
  return all;
}

struct Row {
  std::string row;
  double off = 0, off_p95 = 0, half_width = 0, held = 0;  // of the force
  double top = 0;                                         // the topmost 3 mm's modulus over the truth
  double later_s = 0, latest_s = 0;                       // from a slice's last byte of RF to touchable
  double asked_s = 0, unseen = 0;                         // from asked for to published; of the path
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Row, row, off, off_p95, half_width, held, top, later_s, latest_s, asked_s,
                                   unseen)
struct PatientsFigures {
  std::vector<Row> rows;
  Quantiles off, later_s;  // of all poses and slices of the ten
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PatientsFigures, rows, off, later_s)

struct PatientsOptions : SuiteOptions {
  std::string teletact = "./teletact", runs = "patients-out", only;
};

std::string quoted(const std::string& word) {
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

// The summary of a demo on it, which is run where there is none yet.
json summary_of(const Case& c, const PatientsOptions& options) {
  const fs::path folder = fs::path(options.runs) / snake_case(c.row), file = folder / "summary.json";
  if (fs::exists(file)) {
    fmt::print("taken as it is there: {}\n", file.string());
  } else {
    fs::create_directories(folder);
    Tissue tissue = client::random_solid_tissue(c.seed);
    c.change(*tissue.solid);
    const fs::path path = folder / "tissue.toml";
    client::write_tissue(path, tissue);
    const std::string command =
        fmt::format("{} demo --tissue {} --surface {} --out {}", quoted(options.teletact),
                    quoted(path.string()), c.surface, quoted(folder.string()));
    fmt::print("{}\n", command);
    std::fflush(stdout);
    const int status = std::system(command.c_str());
    if (!fs::exists(file))
      throw BenchError(fmt::format("{}: the demo left no summary.json (status {}); --teletact is the script",
                                   folder.string(), status));
  }
  std::ifstream in(file);
  json summary = json::parse(in);
  if (summary.at("top")["over_truth"].is_null() || summary.at("interval")["half_width"].is_null() ||
      summary.at("slices")["touchable_s"].size() < 2)
    throw BenchError(fmt::format("{}: no slices, or no forces with an interval; look there, and remove it",
                                 file.string()));
  return summary;
}

// What each pose's force is off by, over the true one.
std::vector<double> off_by(const json& summary) {
  std::vector<double> off;
  for (const json& pose : summary.at("poses")) {
    const auto force_n = [&](const char* key) {
      const auto n = pose.at(key).get<std::array<double, 3>>();
      return Eigen::Vector3d(n[0], n[1], n[2]);
    };
    off.push_back((force_n("felt_n") - force_n("true_n")).norm() / force_n("true_n").norm());
  }
  return off;
}

// Over the ten.
struct Pooled {
  std::vector<double> off, later_s, asked_s, half_width, held, unseen, first_s, top, beyond, p99_s, servo_hz;
  double stalls = 0, missed = 0, invented = 0;
};

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

Row row_of(const Case& c, const json& s, Pooled* pooled) {
  Row row{.row = c.row};
  const std::vector<double> off = off_by(s);
  std::vector<double> later_s = s["slices"]["touchable_s"];
  const double first_s = later_s.at(0);
  later_s.erase(later_s.begin());
  const Quantiles q = quantiles(later_s);
  row.off = quantiles(off).p50, row.off_p95 = quantiles(off).p95;
  row.half_width = s["interval"]["half_width"], row.held = s["interval"]["held"];
  row.top = s["top"]["over_truth"];
  row.later_s = q.p50, row.latest_s = q.max;
  row.asked_s = s["slices"]["request_s"], row.unseen = s["slices"]["unseen_share"];
  if (pooled == nullptr) return row;
  Pooled& p = *pooled;
  p.off.insert(p.off.end(), off.begin(), off.end());
  p.later_s.insert(p.later_s.end(), later_s.begin(), later_s.end());
  p.first_s.push_back(first_s), p.asked_s.push_back(row.asked_s), p.unseen.push_back(row.unseen);
  p.half_width.push_back(row.half_width), p.held.push_back(row.held);
  const double top = std::abs(std::log(row.top));
  p.top.push_back(std::expm1(top)), p.beyond.push_back(top > 1.96 * s["top"]["stated"].get<double>());
  p.p99_s.push_back(s["touch_latency_s"]["p99"]), p.servo_hz.push_back(s["servo"]["rate_hz"]);
  p.stalls += s["stalls"]["count"].get<double>(), p.missed += s["lumps"]["missed"].get<double>();
  p.invented += static_cast<double>(s["lumps"]["invented"].size());
  return row;
}

PatientsFigures measure(const PatientsOptions& options, Promises& promises) {
  PatientsFigures figures;
  Pooled p;
  for (const Case& c : cases()) {
    if (std::string(c.row).find(options.only) == std::string::npos) continue;
    const bool unknown = std::string(c.surface) == "unknown", bare = std::string(c.surface) == "bare";
    figures.rows.push_back(row_of(c, summary_of(c, options), unknown ? &p : nullptr));
    if (!unknown)
      promises.push_back({snake_case(std::string("half width ") + c.row), figures.rows.back().half_width,
                          bare ? 0.15 : 0.65, "1"});
  }
  if (p.held.empty()) return figures;
  figures.off = quantiles(p.off), figures.later_s = quantiles(p.later_s);
  const double held = mean(p.held);
  promises.insert(promises.end(), {{"first_slice_rf_to_touchable", quantiles(p.first_s).max, 2.5, "s"},
                                   {"later_slices_median", figures.later_s.p50, 0.4, "s"},
                                   {"later_slices_p95", figures.later_s.p95, 0.8, "s"},
                                   {"asked_for_to_published_median", quantiles(p.asked_s).p50, 1.2, "s"},
                                   {"path_more_than_5_mm_from_a_slice", mean(p.unseen), 0.02, "1"},
                                   {"stalls", p.stalls, 0},
                                   {"force_off_median", figures.off.p50, 0.02, "1"},
                                   {"force_off_p95", figures.off.p95, 0.06, "1"},
                                   {"half_width_median", quantiles(p.half_width).p50, 0.20, "1"},
                                   {"held_at_least", held, 0.92, "1", false},
                                   {"held_at_most", held, 0.98, "1"},
                                   {"held_of_the_worst_patient", quantiles(p.held).min, 0.85, "1", false},
                                   {"topmost_3_mm_of_the_worst_off_by", quantiles(p.top).max, 0.20, "1"},
                                   {"topmost_3_mm_beyond_what_is_stated", mean(p.beyond), 0.05, "1"},
                                   {"lumps_missed", p.missed, 0},
                                   {"lumps_invented", p.invented, 0},
                                   {"touch_latency_p99_median", quantiles(p.p99_s).p50, 2.8e-3, "s"},
                                   {"servo_median", quantiles(p.servo_hz).p50, 999, "Hz", false}});
  return figures;
}

}  // namespace

void add_patients_suite(CLI::App& app, bool& met) {
  const auto options = std::make_shared<PatientsOptions>();
  CLI::App& suite =
      add_suite(app, "patients", "`demo` on solid patients of ten kinds, and what stating their surface does",
                options, met, measure, [](const PatientsFigures&, const fs::path&) {});
  suite.add_option("--teletact", options->teletact, "the script that runs a demo");
  suite.add_option("--runs", options->runs,
                   "a folder for what the demos leave; one whose summary is there is not run again");
  suite.add_option("--only", options->only, "patients whose row has this");
}

}  // namespace teletact::bench
