// teletact-bench solid-felt: the forces that were felt in a touch of the simulated solid patient, beside
// those of that patient's own tissue at the same poses, and beside what a plane model would have answered.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "bench/curves.h"
#include "bench/suite.h"
#include "bench/suites/solid/patient_truth.h"
#include "client/files/file_io.h"
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

constexpr const char* kShared =
    "what both share: the equations of linear elasticity, the kind of element, the layered preconditioner, "
    "the contact's programme, the shape of the tip and the rule of its skin";
constexpr const char* kOwn =
    "the truth's own: the patient's modulus at each element (no slices), nodes 1 mm apart (the service's: 2) "
    "at other places, finer rows, more tissue around, double, each pose solved anew";

struct Options {
  std::string touch_record, out;
  std::uint64_t seed = 1;
  std::size_t poses = 60;
};

struct Felt {
  double time_s = 0, way_m = 0;
  service::Vector3 at{};
  Vector3d felt_n, true_n, plane_n;
  double truths_nodes = 1;  // of layered tissue: force on the truth's nodes over that on ever finer ones
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
    f.time_s = time_s, f.way_m = way_m, f.at = {tick->x_m, tick->indentation_m, tick->z_m};
    f.felt_n = Vector3d(tick->force_x_n, tick->force_y_n, tick->force_z_n);
  }
  return out;
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

void solve(const SolidPatient& patient, const service::Fingertip& tip, std::vector<Felt>& felt) {
  const auto device = service::Device::open();
  PatientTruth truth(device->queue(), patient, tip);
  for (std::size_t n = 0; n < felt.size(); ++n) {
    show_progress(fmt::format("pose {} of {}", n + 1, felt.size()));
    Felt& f = felt[n];
    const auto [force_n, nodes] = truth.at(f.at);
    f.true_n = force_n, f.truths_nodes = nodes;
    f.plane_n = plane_force(device, patient, tip, f.at);
  }
}

template <class Value>
json quantiles_of(const std::vector<Felt>& felt, const Value& value) {
  std::vector<double> values;
  for (const Felt& f : felt) values.push_back(value(f));
  const Quantiles q = quantiles(values);
  return {{"median", q.p50}, {"p95", q.p95}, {"min", q.min}, {"max", q.max}};
}

json judge(json summary, const std::vector<Felt>& felt, double coverage) {
  const auto off = [](const Vector3d& force_n, const Felt& f) {
    return (force_n - f.true_n).norm() / f.true_n.norm();
  };
  json& error = summary["force_error"] = quantiles_of(felt, [&](const Felt& f) { return off(f.felt_n, f); });
  error["coverage"] = coverage, error["samples"] = felt.size();
  error["excluded"] = "less than 1 mm deep, and while force is ramped";
  summary["plane_error"] = quantiles_of(felt, [&](const Felt& f) { return off(f.plane_n, f); });
  summary["truths_nodes"] = quantiles_of(felt, [](const Felt& f) { return f.truths_nodes - 1; });
  summary["truth"] = {{"shared", kShared}, {"own", kOwn}, {"force_error", PatientTruth::kForceError}};
  for (const Felt& f : felt)
    summary["poses"].push_back({{"time_s", f.time_s},
                                {"position_m", f.at},
                                {"felt_n", {f.felt_n[0], f.felt_n[1], f.felt_n[2]}},
                                {"true_n", {f.true_n[0], f.true_n[1], f.true_n[2]}},
                                {"plane_n", {f.plane_n[0], f.plane_n[1], f.plane_n[2]}},
                                {"truths_nodes", f.truths_nodes - 1}});
  return summary;
}

std::string readable(const json& s) {
  const auto two = [&](const char* key) {
    return fmt::format("median {:.1f} %, p95 {:.1f} %", 100 * s[key]["median"].get<double>(),
                       100 * s[key]["p95"].get<double>());
  };
  const auto range = [&](const char* key) {
    return fmt::format("{:+.1f} to {:+.1f} %", 100 * s[key]["min"].get<double>(),
                       100 * s[key]["max"].get<double>());
  };
  return fmt::format(
      "plane model   {}, through the finger's z, 10 mm thick\n"
      "truth         at {} poses of {:.0f} s; its nodes put it off by {}, extrapolated from 1 and 0.5 mm "
      "(layers alone) and taken off\n              {}\n              {}\n",
      two("plane_error"), s["force_error"]["samples"].get<int>(), s["poses"].back()["time_s"].get<double>(),
      range("truths_nodes"), kOwn, kShared);
}

void draw(const std::vector<Felt>& felt, const SolidPatient& patient, const std::filesystem::path& file) {
  Curve felt_n{.title = "felt", .ours = true, .style = "lines lw 2 lc rgb '#c03020'"},
      truth{.title = "the patient, solid", .style = "points pt 6 ps 1 lc rgb 'black'"},
      plane{.title = "plane model through its z", .style = "lines lw 2 dt 2 lc rgb '#3060a0'"},
      way{.title = "", .style = "linespoints pt 7 ps 0.6 lc rgb '#888888'"};
  for (const Felt& f : felt) {
    felt_n.add(1e3 * f.way_m, f.felt_n.norm());
    truth.add(1e3 * f.way_m, f.true_n.norm());
    plane.add(1e3 * f.way_m, f.plane_n.norm());
    way.add(1e3 * f.at[0], 1e3 * f.at[2]);
  }
  std::string lumps;
  for (const client::Lump& l : patient.lumps)
    lumps += fmt::format("set object circle at {},{} size {} fc rgb '#e0b070' fs solid noborder behind\n",
                         1e3 * l.x_m, 1e3 * l.z_m, 1e3 * l.radius_m);
  plot(file,
       "set multiplot layout 2,1\n" +
           script_of({felt_n, truth, plane},
                     "set yrange [0:*]\nset key bottom right\n" +
                         axes("Force along the way of the finger", "way (mm)", "force (N)")) +
           script_of({way}, "unset key\nset yrange [*:*]\nset size ratio -1\n" + lumps +
                                axes("The judged poses and the lumps, from above", "x (mm)", "z (mm)")) +
           "unset multiplot\n");
}

bool run(const Options& options) {
  const std::filesystem::path out = options.out;
  std::error_code error;
  std::filesystem::create_directories(out, error);
  if (error) throw BenchError("--out " + options.out + ": cannot be created (" + error.message() + ")");
  const client::TouchRecord touch = client::read_touch_record(options.touch_record);
  const SolidPatient patient = client::random_solid_patient(options.seed);
  const std::vector<client::TouchTick> path = client::felt_path(touch.ticks);
  const double coverage = coverage_of(path);
  const service::Fingertip tip = tip_of(touch);
  std::vector<Felt> felt = chosen(path, options.poses);
  std::fprintf(stderr, "solving the patient's own tissue at %zu poses\n", felt.size());
  solve(patient, tip, felt);
  json summary = judge(client::summarise(touch, TELETACT_VERSION), felt, coverage);
  std::vector<client::Promise> promises = client::promises_of(summary);
  promises.push_back({"force_error median", summary["force_error"]["median"], kForceMedian, "1"});
  promises.push_back({"force_error coverage", coverage, kCoverage, "1", false});
  const bool met = client::set_targets(summary, promises);
  client::write_file(out / "summary.json", summary.dump(2) + "\n");
  draw(felt, patient, out / "force.png");
  client::draw_latency(out / "latency.png", touch);
  client::draw_periods(out / "periods.png", touch);
  client::draw_tactile(out / "tactile.png", touch);
  std::printf("%s%s%s", client::readable(summary).c_str(), readable(summary).c_str(),
              client::not_met(summary).c_str());
  return met;
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
  command.add_option("--poses", options->poses, "so many are judged, evenly over the touch")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command.add_option("--out", options->out, "folder for summary.json and the pictures")->required();
  command.callback([options] {
    if (!run(*options)) throw CLI::RuntimeError(kPromisesMissed);
  });
}

}  // namespace teletact::bench
