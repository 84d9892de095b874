// teletact-bench solid-felt: the forces that were felt in a touch of a simulated solid patient, beside those
// of that patient's own tissue at the same poses: of one whose modulus was given beside what a plane model
// would have answered, too; of one that was imaged slice by slice with what is stated of them, and with its
// lumps.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "bench/curves.h"
#include "bench/suite.h"
#include "bench/suites/solid/found_lumps.h"
#include "bench/suites/solid/patient_truth.h"
#include "client/acquire/solid_source.h"
#include "client/files/file_io.h"
#include "client/files/metaimage.h"
#include "client/patient/solid_patient.h"
#include "client/report/force_error.h"
#include "client/report/pictures.h"
#include "client/report/session_record.h"
#include "client/report/summary.h"
#include "service/device/device.h"
#include "service/touch_plane/touch_session.h"
#include "tests/solid/solids.h"

namespace teletact::bench {
namespace {

using client::SolidPatient;
using Eigen::Vector3d;
using nlohmann::json;

constexpr int kPromisesMissed = 2;     // exit code, as of teletact-client report
constexpr double kLeastForceN = 0.05;  // a force that is felt is more
constexpr double kPressedM = 0.001;    // so deep a finger is owed a force
constexpr double kForceMedian = 0.02, kCoverage = 0.90;
// From RF: the force, and how much of the path a stated interval of 95 % holds.
constexpr double kForceMedianFromRf = 0.10, kHeldAtLeast = 0.90;
// What must be found.
constexpr double kLeastContrast = 3, kLeastDiameterM = 0.008, kDeepestM = 0.020;
constexpr double kSameTouchM = 0.002;  // an answer's place, and where it is felt
constexpr double kSliceReachM = 0.005;

constexpr const char* kShared =
    "what both share: the equations of linear elasticity, the kind of element, the layered preconditioner, "
    "the contact's programme, the shape of the tip and the rule of its skin";
constexpr const char* kOwn =
    "the truth's own: the patient's modulus at each element (no slices), nodes 1 mm apart (the service's: 2) "
    "at other places, finer rows, more tissue around, double, each pose solved anew";

struct Options {
  std::string touch_record, out;
  std::uint64_t seed = 1;
  std::string tissue, modulus, acquire_record;  // of a patient that was imaged
  std::size_t poses = 60;
};

struct Felt {
  double time_s = 0, clock_s = 0, way_m = 0;  // since the first; as recorded
  service::Vector3 at{};
  Vector3d felt_n, true_n, plane_n;
  double truths_nodes = 1;  // of layered tissue: force on the truth's nodes over that on ever finer ones
  // What the newest answer states that the force may be off by, over it; none: it stated nothing.
  std::optional<double> half_width;
  bool held() const { return half_width && (felt_n - true_n).norm() <= *half_width * felt_n.norm(); }
};

service::Fingertip tip_of(const client::TouchRecord& touch) {
  if (!touch.untold.empty()) throw BenchError(touch.untold);
  service::Fingertip tip;
  if (touch.finger.shape == client::FingerShape::kNode) {
    tip.shape = service::FingertipShape::kNode, tip.footprint_m = touch.finger.footprint_m;
    if (!(tip.footprint_m > 0)) throw BenchError("touched by one node of its mesh: others feel another tip");
  }
  if (touch.finger.shape == client::FingerShape::kFlatPunch) tip.shape = service::FingertipShape::kFlatPunch;
  tip.radius_m = touch.finger.radius_m, tip.half_width_m = touch.finger.half_width_m;
  return tip;
}

// Deep enough to be owed a force, whatever was felt.
bool pressed(const client::TouchTick& tick) {
  return tick.indentation_m >= kPressedM;
}

// In the middle of each of so many parts of the path.
std::vector<Felt> chosen(const std::vector<client::TouchTick>& path, std::size_t count) {
  const auto first = std::find_if(path.begin(), path.end(), pressed);
  const auto last = std::find_if(path.rbegin(), path.rend(), pressed).base();
  if (first >= last) throw BenchError("the finger never pressed the tissue: there is no force to judge");
  const double begin_s = first->time_s, part_s = ((last - 1)->time_s - begin_s) / double(count);
  std::vector<Felt> out;
  double way_m = 0, next_s = part_s / 2;
  for (auto tick = first; tick != last && out.size() < count; ++tick) {
    if (tick != first) way_m += std::hypot(tick->x_m - (tick - 1)->x_m, tick->z_m - (tick - 1)->z_m);
    const double time_s = tick->time_s - begin_s;
    if (!pressed(*tick) || time_s < next_s) continue;
    next_s = part_s > 0 ? (std::floor(time_s / part_s) + 1.5) * part_s : 0;
    Felt& f = out.emplace_back();
    f.time_s = time_s, f.clock_s = tick->time_s, f.way_m = way_m,
    f.at = {tick->x_m, tick->indentation_m, tick->z_m};
    f.felt_n = Vector3d(tick->force_x_n, tick->force_y_n, tick->force_z_n);
  }
  return out;
}

// Of the answers that had come by then: the newest, if it is of this touch.
void state_intervals(const client::TouchRecord& touch, std::vector<Felt>& felt) {
  for (Felt& f : felt) {
    const auto after =
        std::ranges::upper_bound(touch.answers, f.clock_s, {}, &client::TouchAnswerTime::arrived_s);
    if (after == touch.answers.begin()) continue;
    const client::TouchAnswerTime& answer = *(after - 1);
    if (std::hypot(answer.x_m - f.at[0], answer.z_m - f.at[2]) <= kSameTouchM)
      f.half_width = answer.half_width;
  }
}

// Of the pressed path: the share that had a force.
double coverage_of(const std::vector<client::TouchTick>& path) {
  const auto owed = std::ranges::count_if(path, pressed);
  const auto felt = std::ranges::count_if(path, [](const client::TouchTick& tick) {
    return pressed(tick) && tick.enabled && -tick.force_y_n > kLeastForceN;
  });
  return owed > 0 ? double(felt) / double(owed) : 0;
}

// Plane strain through the finger's z.
Vector3d plane_force(const std::shared_ptr<service::Device>& device, const SolidPatient& patient,
                     const service::Fingertip& tip, const service::Vector3& pose) {
  service::ExplicitModulus e;
  e.x_m = service::uniform_coordinates(0, SolidPatient::kWidthM, 112);
  e.y_m = service::uniform_coordinates(0, SolidPatient::kDepthM, 40);
  for (std::size_t j = 0; j + 1 < e.y_m.size(); ++j)
    for (std::size_t i = 0; i + 1 < e.x_m.size(); ++i)
      e.youngs_modulus_pa.push_back(
          patient.modulus_pa((e.x_m[i] + e.x_m[i + 1]) / 2, (e.y_m[j] + e.y_m[j + 1]) / 2, pose[2]));
  service::SceneGeometry geometry;
  geometry.width_m = SolidPatient::kWidthM, geometry.depth_m = SolidPatient::kDepthM;
  service::TouchSession finger(
      std::make_shared<service::Scene>("plane", geometry, std::move(e),
                                       std::make_shared<service::VersionCounter>(nullptr)),
      {.fingertip = tip}, device);
  const auto answer = finger.solve({pose[0], pose[1], 0});
  if (answer.contact.state != service::ContactState::kContact)
    throw BenchError("the plane model does not answer: " + answer.warning);
  return Eigen::Map<const Vector3d>(answer.contact.force_n.data());
}

// `plane`: whose plane model is asked, too.
void solve(const TrueSolid& solid, const SolidPatient* plane, const service::Fingertip& tip,
           std::vector<Felt>& felt) {
  const auto device = service::Device::open();
  PatientTruth truth(device->queue(), solid, tip);
  for (std::size_t n = 0; n < felt.size(); ++n) {
    show_progress(fmt::format("pose {} of {}", n + 1, felt.size()));
    Felt& f = felt[n];
    const auto [force_n, nodes] = truth.at(f.at);
    f.true_n = force_n, f.truths_nodes = nodes;
    if (plane) f.plane_n = plane_force(device, *plane, tip, f.at);
  }
}

template <class Value>
json quantiles_of(const std::vector<Felt>& felt, const Value& value) {
  std::vector<double> values;
  for (const Felt& f : felt) values.push_back(value(f));
  const Quantiles q = quantiles(values);
  return {{"median", q.p50}, {"p95", q.p95}, {"min", q.min}, {"max", q.max}};
}

double off(const Vector3d& force_n, const Felt& f) {
  return (force_n - f.true_n).norm() / f.true_n.norm();
}

json judge(json summary, const std::vector<Felt>& felt, double coverage) {
  json& error = summary["force_error"] = quantiles_of(felt, [&](const Felt& f) { return off(f.felt_n, f); });
  error["coverage"] = coverage, error["samples"] = felt.size();
  error["excluded"] = "less than 1 mm deep, and while force is ramped";
  summary["truths_nodes"] = quantiles_of(felt, [](const Felt& f) { return f.truths_nodes - 1; });
  summary["truth"] = {{"shared", kShared}, {"own", kOwn}, {"force_error", PatientTruth::kForceError}};
  for (const Felt& f : felt)
    summary["poses"].push_back({{"time_s", f.time_s},
                                {"position_m", f.at},
                                {"felt_n", {f.felt_n[0], f.felt_n[1], f.felt_n[2]}},
                                {"true_n", {f.true_n[0], f.true_n[1], f.true_n[2]}},
                                {"half_width", f.half_width ? json(*f.half_width) : json()},
                                {"truths_nodes", f.truths_nodes - 1}});
  return summary;
}

void judge_plane(json& summary, const std::vector<Felt>& felt) {
  summary["plane_error"] = quantiles_of(felt, [](const Felt& f) { return off(f.plane_n, f); });
  for (std::size_t n = 0; n < felt.size(); ++n)
    summary["poses"][n]["plane_n"] = {felt[n].plane_n[0], felt[n].plane_n[1], felt[n].plane_n[2]};
}

// How much of the path the stated intervals hold, and how wide they are.
void judge_intervals(json& summary, const std::vector<Felt>& felt) {
  std::vector<double> widths;
  for (const Felt& f : felt)
    if (f.half_width) widths.push_back(*f.half_width);
  json& interval = summary["interval"];
  interval["held"] = double(std::ranges::count_if(felt, &Felt::held)) / double(felt.size());
  interval["stated"] = double(widths.size()) / double(felt.size());
  interval["half_width"] = widths.empty() ? json() : json(quantiles(widths).p50);
}

// What had been imaged where the finger was when it was there.
void judge_slices(json& summary, const client::AcquireRecord& acquire,
                  const std::vector<client::TouchTick>& path) {
  std::vector<double> request_s;
  for (const client::AcquiredWindow& slice : acquire.windows) request_s.push_back(slice.request_s);
  double on_unseen = 0, on = 0;
  for (const client::TouchTick& tick : path) {
    if (!pressed(tick)) continue;
    const bool seen = std::ranges::any_of(acquire.windows, [&](const client::AcquiredWindow& slice) {
      return slice.published_s <= tick.time_s && std::abs(slice.z_m - tick.z_m) <= kSliceReachM;
    });
    ++on, on_unseen += !seen;
  }
  const double begin_s = path.empty() ? 0 : path.front().time_s;
  const auto later =
      std::ranges::count_if(acquire.windows, [&](const auto& slice) { return slice.published_s > begin_s; });
  summary["slices"] = {{"published", acquire.windows.size()},
                       {"while_touching", later},
                       {"request_s", request_s.empty() ? json() : json(quantiles(request_s).p50)},
                       {"unseen_share", on > 0 ? on_unseen / on : 0}};
}

void judge_lumps(json& summary, const client::MetaImage& volume, const client::Tissue& tissue) {
  std::vector<client::Inclusion> truth = tissue.inclusions;
  for (client::Inclusion& i : truth) i.x_m -= client::slice_window_x_m(tissue);
  const LumpReport report = find_lumps(volume, truth);
  json& lumps = summary["lumps"] = {
      {"background_pa", report.background_pa}, {"true", json::array()}, {"invented", json::array()}};
  double missed = 0;
  for (std::size_t t = 0; t < truth.size(); ++t) {
    const client::Inclusion& i = truth[t];
    const bool owed = i.contrast >= kLeastContrast && i.diameter_m >= kLeastDiameterM &&
                      i.y_m + i.diameter_m / 2 <= kDeepestM + 1e-9;
    json& lump = lumps["true"].emplace_back(json{{"position_m", {i.x_m, i.y_m, i.z_m}},
                                                 {"diameter_m", i.diameter_m},
                                                 {"contrast", i.contrast},
                                                 {"owed", owed}});
    if (report.match[t] < 0) {
      missed += owed;
      continue;
    }
    const FoundLump& f = report.found[std::size_t(report.match[t])];
    lump["found"] = {{"position_m", {f.x_m, f.y_m, f.z_m}},
                     {"diameter_m", f.diameter_m},
                     {"contrast", f.contrast},
                     {"apart_m", std::hypot(i.x_m - f.x_m, i.y_m - f.y_m, i.z_m - f.z_m)}};
  }
  for (const std::size_t n : report.invented) {
    const FoundLump& f = report.found[n];
    lumps["invented"].push_back(
        {{"position_m", {f.x_m, f.y_m, f.z_m}}, {"diameter_m", f.diameter_m}, {"contrast", f.contrast}});
  }
  lumps["missed"] = missed;
}

std::string two(const json& s, const char* key) {
  return fmt::format("median {:.1f} %, p95 {:.1f} %", 100 * s[key]["median"].get<double>(),
                     100 * s[key]["p95"].get<double>());
}

std::string place(const json& position_m) {
  return fmt::format("x {:.1f}, y {:.1f}, z {:.1f} mm", 1e3 * position_m[0].get<double>(),
                     1e3 * position_m[1].get<double>(), 1e3 * position_m[2].get<double>());
}

std::string readable_from_rf(const json& s) {
  const json& slices = s["slices"];
  const json& interval = s["interval"];
  std::string out = fmt::format(
      "slices        {} published, {} of them while touching; asked for to published {:.1f} s (median); the "
      "finger was more than 5 mm from a slice that was there over {:.1f} % of its path\n"
      "interval      95 % are stated: it holds the true force over {:.1f} % of the path; half width {:.0f} % "
      "of "
      "the force (median)\n",
      slices["published"].get<int>(), slices["while_touching"].get<int>(), slices["request_s"].get<double>(),
      100 * slices["unseen_share"].get<double>(), 100 * interval["held"].get<double>(),
      interval["half_width"].is_null() ? 0 : 100 * interval["half_width"].get<double>());
  for (const json& lump : s["lumps"]["true"]) {
    out += fmt::format("lump          {}, diameter {:.1f} mm: ", place(lump["position_m"]),
                       1e3 * lump["diameter_m"].get<double>());
    if (lump.contains("found"))
      out += fmt::format("contrast {:.1f} / {:.1f} (true / found), {:.1f} mm off\n",
                         lump["contrast"].get<double>(), lump["found"]["contrast"].get<double>(),
                         1e3 * lump["found"]["apart_m"].get<double>());
    else
      out += fmt::format("contrast {:.1f}, not found\n", lump["contrast"].get<double>());
  }
  for (const json& lump : s["lumps"]["invented"])
    out += fmt::format("invented      {}, diameter {:.1f} mm, contrast {:.1f}\n", place(lump["position_m"]),
                       1e3 * lump["diameter_m"].get<double>(), lump["contrast"].get<double>());
  return out;
}

std::string readable(const json& s) {
  const auto range = [&](const char* key) {
    return fmt::format("{:+.1f} to {:+.1f} %", 100 * s[key]["min"].get<double>(),
                       100 * s[key]["max"].get<double>());
  };
  const std::string plane =
      s.contains("plane_error")
          ? fmt::format("plane model   {}, through the finger's z, 10 mm thick\n", two(s, "plane_error"))
          : "";
  return plane + fmt::format(
                     "truth         at {} poses of {:.0f} s; its nodes put it off by {}, extrapolated from 1 "
                     "and 0.5 mm "
                     "(layers alone) and taken off\n              {}\n              {}\n",
                     s["force_error"]["samples"].get<int>(), s["poses"].back()["time_s"].get<double>(),
                     range("truths_nodes"), kOwn, kShared);
}

// A lump from above.
struct Shadow {
  double x_m, z_m, radius_m;
};

void draw(const std::vector<Felt>& felt, const std::vector<Shadow>& shadows, bool with_plane,
          const std::filesystem::path& file) {
  Curve felt_n{.title = "felt", .ours = true, .style = "lines lw 2 lc rgb '#c03020'"},
      truth{.title = "the patient, solid", .style = "points pt 6 ps 1 lc rgb 'black'"},
      plane{.title = "plane model through its z", .style = "lines lw 2 dt 2 lc rgb '#3060a0'"},
      way{.title = "", .style = "linespoints pt 7 ps 0.6 lc rgb '#888888'"};
  for (const Felt& f : felt) {
    felt_n.add(1e3 * f.way_m, f.felt_n.norm());
    truth.add(1e3 * f.way_m, f.true_n.norm());
    if (with_plane) plane.add(1e3 * f.way_m, f.plane_n.norm());
    way.add(1e3 * f.at[0], 1e3 * f.at[2]);
  }
  std::string lumps;
  for (const Shadow& l : shadows)
    lumps += fmt::format("set object circle at {},{} size {} fc rgb '#e0b070' fs solid noborder behind\n",
                         1e3 * l.x_m, 1e3 * l.z_m, 1e3 * l.radius_m);
  std::vector<Curve> curves{felt_n, truth};
  if (with_plane) curves.push_back(plane);
  plot(file,
       "set multiplot layout 2,1\n" +
           script_of(curves, "set yrange [0:*]\nset key bottom right\n" +
                                 axes("Force along the way of the finger", "way (mm)", "force (N)")) +
           script_of({way}, "unset key\nset yrange [*:*]\nset size ratio -1\n" + lumps +
                                axes("The judged poses and the lumps, from above", "x (mm)", "z (mm)")) +
           "unset multiplot\n");
}

// What a touch was, and where it is judged.
struct Judged {
  client::TouchRecord touch;
  std::vector<client::TouchTick> path;
  double coverage = 0;
  service::Fingertip tip;
  std::vector<Felt> felt;
};

Judged judged(const Options& options) {
  Judged j;
  j.touch = client::read_touch_record(options.touch_record);
  j.path = client::felt_path(j.touch.ticks);
  j.coverage = coverage_of(j.path);
  j.tip = tip_of(j.touch);
  j.felt = chosen(j.path, options.poses);
  state_intervals(j.touch, j.felt);
  std::fprintf(stderr, "solving the patient's own tissue at %zu poses\n", j.felt.size());
  return j;
}

bool conclude(const Options& options, const Judged& j, json summary, std::vector<client::Promise> own,
              const std::string& lines) {
  const std::filesystem::path out = options.out;
  std::vector<client::Promise> promises = client::promises_of(summary);
  promises.insert(promises.end(), own.begin(), own.end());
  promises.push_back({"force_error coverage", j.coverage, kCoverage, "1", false});
  const bool met = client::set_targets(summary, promises);
  client::write_file(out / "summary.json", summary.dump(2) + "\n");
  client::draw_latency(out / "latency.png", j.touch);
  client::draw_periods(out / "periods.png", j.touch);
  client::draw_tactile(out / "tactile.png", j.touch);
  std::printf("%s%s%s", client::readable(summary).c_str(), lines.c_str(), client::not_met(summary).c_str());
  return met;
}

bool run_given(const Options& options) {
  Judged j = judged(options);
  const SolidPatient patient = client::random_solid_patient(options.seed);
  solve(true_solid(patient), &patient, j.tip, j.felt);
  json summary = judge(client::summarise(j.touch, TELETACT_VERSION), j.felt, j.coverage);
  judge_plane(summary, j.felt);
  std::vector<Shadow> shadows;
  for (const client::Lump& l : patient.lumps) shadows.push_back({l.x_m, l.z_m, l.radius_m});
  draw(j.felt, shadows, true, std::filesystem::path(options.out) / "force.png");
  return conclude(options, j, summary,
                  {{"force_error median", summary["force_error"]["median"], kForceMedian, "1"}},
                  readable(summary));
}

bool run_from_rf(const Options& options) {
  const client::Tissue tissue = client::read_tissue(options.tissue);
  const client::MetaImage volume = client::read_metaimage(options.modulus);
  const client::AcquireRecord acquire = client::read_acquire_record(options.acquire_record);
  Judged j = judged(options);
  if (const std::string mismatch = client::session_mismatch(j.touch, acquire); !mismatch.empty())
    std::fprintf(stderr, "warning: %s\n", mismatch.c_str());
  solve(true_solid(tissue), nullptr, j.tip, j.felt);
  json summary = judge(client::summarise(j.touch, TELETACT_VERSION), j.felt, j.coverage);
  judge_intervals(summary, j.felt);
  judge_slices(summary, acquire, j.path);
  judge_lumps(summary, volume, tissue);
  std::vector<Shadow> shadows;
  for (const client::Inclusion& i : tissue.inclusions)
    shadows.push_back({i.x_m - client::slice_window_x_m(tissue), i.z_m, i.diameter_m / 2});
  draw(j.felt, shadows, false, std::filesystem::path(options.out) / "force.png");
  const double held = summary["interval"]["held"];
  return conclude(options, j, summary,
                  {{"force_error median", summary["force_error"]["median"], kForceMedianFromRf, "1"},
                   {"interval held", held, kHeldAtLeast, "1", false},
                   {"lumps missed", summary["lumps"]["missed"], 0, ""},
                   {"lumps invented", double(summary["lumps"]["invented"].size()), 0, ""}},
                  readable_from_rf(summary) + readable(summary));
}

bool run(const Options& options) {
  std::error_code error;
  std::filesystem::create_directories(options.out, error);
  if (error) throw BenchError("--out " + options.out + ": cannot be created (" + error.message() + ")");
  return options.tissue.empty() ? run_given(options) : run_from_rf(options);
}

}  // namespace

void add_solid_felt_command(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App& command = *app.add_subcommand(
      "solid-felt", "a touch of the simulated solid patient beside that patient's own tissue");
  command.add_option("--touch-record", options->touch_record, "written by teletact-client touch --record")
      ->required();
  command.add_option("--seed", options->seed, "of the patient that was touched: teletact-client slices")
      ->capture_default_str();
  CLI::Option* tissue = command.add_option("--tissue", options->tissue,
                                           "instead: the solid that acquire --slices imaged, as it saved it");
  command.get_option("--seed")->excludes(tissue);
  CLI::Option* modulus =
      command.add_option("--modulus", options->modulus, "with it: the volume that acquire saved")
          ->needs(tissue);
  CLI::Option* record =
      command.add_option("--acquire-record", options->acquire_record, "with it: written by acquire --record")
          ->needs(tissue);
  tissue->needs(modulus)->needs(record);
  command.add_option("--poses", options->poses, "so many are judged, evenly over the touch")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command.add_option("--out", options->out, "folder for summary.json and the pictures")->required();
  command.callback([options] {
    if (!run(*options)) throw CLI::RuntimeError(kPromisesMissed);
  });
}

}  // namespace teletact::bench
