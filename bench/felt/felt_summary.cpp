#include "bench/felt/felt_summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "bench/curves.h"
#include "bench/felt/found_lumps.h"
#include "bench/felt/patient_truth.h"
#include "bench/suite.h"
#include "client/acquire/solid_source.h"
#include "client/patient/true_modulus.h"

namespace teletact::bench {
namespace {

using Eigen::Vector3d;
using nlohmann::json;

constexpr double kPressedM = 0.001;
// What must be found.
constexpr double kMinContrast = 3, kMinDiameterM = 0.008, kDeepestM = 0.020;
constexpr double kSliceReachM = 0.005, kTopM = 0.003;
constexpr int kParts = 8;  // of an element's height: a capsule may be thinner

constexpr const char* kShared =
    "what both share: the equations of linear elasticity, the kind of element, the layered preconditioner, "
    "the contact's programme, the shape of the tip and the rule of its skin";
constexpr const char* kOwn =
    "the truth's own: the patient's modulus at each element (no slices), nodes 1 mm apart (the service's: 2) "
    "at other places, its support, finer rows, more tissue around, double, each pose solved anew";

template <class Value>
json quantiles_of(const std::vector<FeltPose>& felt, const Value& value) {
  std::vector<double> values;
  for (const FeltPose& f : felt) values.push_back(value(f));
  const Quantiles q = quantiles(values);
  return {{"median", q.p50}, {"p95", q.p95}, {"min", q.min}, {"max", q.max}};
}

double off(const Vector3d& force_n, const FeltPose& f) {
  return (force_n - f.true_n).norm() / f.true_n.norm();
}

std::string two(const json& s, const char* key) {
  return fmt::format("median {:.1f} %, p95 {:.1f} %", 100 * s[key]["median"].get<double>(),
                     100 * s[key]["p95"].get<double>());
}

std::string range_of(const json& s) {
  return fmt::format("{:+.1f} to {:+.1f} %", 100 * s["min"].get<double>(), 100 * s["max"].get<double>());
}

std::string place(const json& position_m) {
  return fmt::format("x {:.1f}, y {:.1f}, z {:.1f} mm", 1e3 * position_m[0].get<double>(),
                     1e3 * position_m[1].get<double>(), 1e3 * position_m[2].get<double>());
}

}  // namespace

bool pressed(const client::TouchTick& tick) {
  return tick.indentation_m >= kPressedM;
}

json judge(json summary, const std::vector<FeltPose>& felt, double coverage) {
  json& error = summary["force_error"] =
      quantiles_of(felt, [&](const FeltPose& f) { return off(f.felt_n, f); });
  error["coverage"] = coverage, error["samples"] = felt.size();
  error["excluded"] = "less than 1 mm deep, and while force is ramped";
  summary["truths_nodes"] = quantiles_of(felt, [](const FeltPose& f) { return f.truths_nodes - 1; });
  summary["truth"] = {{"shared", kShared}, {"own", kOwn}, {"force_error", PatientTruth::kForceError}};
  for (const FeltPose& f : felt)
    summary["poses"].push_back({{"time_s", f.time_s},
                                {"position_m", f.at},
                                {"felt_n", {f.felt_n[0], f.felt_n[1], f.felt_n[2]}},
                                {"true_n", {f.true_n[0], f.true_n[1], f.true_n[2]}},
                                {"half_width", f.half_width ? json(*f.half_width) : json()},
                                {"truths_nodes", f.truths_nodes - 1}});
  return summary;
}

void judge_plane(json& summary, const std::vector<FeltPose>& felt) {
  summary["plane_error"] = quantiles_of(felt, [](const FeltPose& f) { return off(f.plane_n, f); });
  for (std::size_t n = 0; n < felt.size(); ++n)
    summary["poses"][n]["plane_n"] = {felt[n].plane_n[0], felt[n].plane_n[1], felt[n].plane_n[2]};
}

void judge_intervals(json& summary, const std::vector<FeltPose>& felt) {
  std::vector<double> widths;
  for (const FeltPose& f : felt)
    if (f.half_width) widths.push_back(*f.half_width);
  json& interval = summary["interval"];
  interval["held"] = double(std::ranges::count_if(felt, &FeltPose::held)) / double(felt.size());
  interval["stated"] = double(widths.size()) / double(felt.size());
  interval["half_width"] = widths.empty() ? json() : json(quantiles(widths).p50);
}

void judge_by_20_nodes(json& summary, const std::vector<FeltPose>& felt) {
  std::vector<double> truth, by_felt;
  for (std::size_t n = 0; n < felt.size(); ++n) {
    const FeltPose& f = felt[n];
    if (!f.by_20_nodes_n) continue;
    summary["poses"][n]["by_20_nodes_n"] = *f.by_20_nodes_n;
    truth.push_back(std::abs(f.true_n.y()) / *f.by_20_nodes_n - 1);
    by_felt.push_back(std::abs(f.felt_n.y()) / *f.by_20_nodes_n - 1);
  }
  if (truth.empty()) return;
  const auto spread = [](const std::vector<double>& off) {
    const auto [least, most] = std::ranges::minmax(off);
    return json{{"median", quantiles(off).p50}, {"min", least}, {"max", most}};
  };
  summary["by_20_nodes"] = {{"poses", truth.size()}, {"truth", spread(truth)}, {"felt", spread(by_felt)}};
}

void judge_slices(json& summary, const client::AcquireRecord& acquire,
                  const std::vector<client::TouchTick>& path) {
  std::vector<double> request_s, touchable_s;
  for (const client::AcquiredWindow& slice : acquire.windows) {
    request_s.push_back(slice.request_s);
    touchable_s.push_back(slice.received_to_published_s);
  }
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
                       {"touchable_s", touchable_s},
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
    const bool owed = i.contrast >= kMinContrast && i.diameter_m >= kMinDiameterM &&
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

void judge_top(json& summary, const client::MetaImage& volume, const client::MetaImage& log_std,
               const client::Tissue& tissue) {
  const std::vector<float> modulus = volume.as<float>(), stated = log_std.as<float>();
  if (volume.size != log_std.size) throw BenchError("--log-std: as large as the volume of --modulus");
  const client::TrueModulus truth(tissue);
  const auto place = [&](std::size_t axis, std::size_t n) {
    return volume.origin[axis] + volume.spacing[axis] * double(n);
  };
  double off = 0, deviation = 0, count = 0;
  for (std::size_t n = 0; n < modulus.size(); ++n) {
    const std::size_t i = n % volume.size[0], row = n / volume.size[0];
    const double y_m = place(1, row % volume.size[1]);
    if (y_m > kTopM || !std::isfinite(modulus[n])) continue;
    double log_truth = 0;
    for (int part = 0; part < kParts; ++part)
      log_truth += std::log(truth(place(0, i) + client::slice_window_x_m(tissue),
                                  y_m + ((part + 0.5) / kParts - 0.5) * volume.spacing[1],
                                  place(2, row / volume.size[1]))) /
                   kParts;
    off += std::log(modulus[n]) - log_truth, deviation += stated[n], ++count;
  }
  summary["top"] = {{"depth_m", kTopM}, {"over_truth", std::exp(off / count)}, {"stated", deviation / count}};
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
  const std::string plane =
      s.contains("plane_error")
          ? fmt::format("plane model   {}, through the finger's z, 10 mm thick\n", two(s, "plane_error"))
          : "";
  const std::string by_20_nodes =
      s.contains("by_20_nodes")
          ? fmt::format(
                "20 nodes      at {} poses, sides that end: from their normal force the truth is {} "
                "away, what is felt {}\n",
                s["by_20_nodes"]["poses"].get<int>(), range_of(s["by_20_nodes"]["truth"]),
                range_of(s["by_20_nodes"]["felt"]))
          : "";
  return plane + by_20_nodes +
         fmt::format(
             "truth         at {} poses of {:.0f} s; its nodes put it off by {}, extrapolated from 1 "
             "and 0.5 mm "
             "(layers alone) and taken off\n              {}\n              {}\n",
             s["force_error"]["samples"].get<int>(), s["poses"].back()["time_s"].get<double>(),
             range_of(s["truths_nodes"]), kOwn, kShared);
}

void draw(const std::vector<FeltPose>& felt, const std::vector<Shadow>& shadows, bool with_plane,
          const std::filesystem::path& file) {
  Curve stated{.title = "stated for what is felt, 95 %", .style = "yerrorbars pt 0 lw 5 lc rgb '#f0b8a8'"},
      felt_n{.title = "felt", .ours = true, .style = "lines lw 2 lc rgb '#c03020'"},
      truth{.title = "the patient, solid", .style = "points pt 6 ps 1 lc rgb 'black'"},
      plane{.title = "plane model through its z", .style = "lines lw 2 dt 2 lc rgb '#3060a0'"},
      way{.title = "", .style = "linespoints pt 7 ps 0.6 lc rgb '#888888'"};
  for (const FeltPose& f : felt) {
    if (f.half_width) {
      stated.add(1e3 * f.way_m, f.felt_n.norm());
      stated.half_width.push_back(*f.half_width * f.felt_n.norm());
    }
    felt_n.add(1e3 * f.way_m, f.felt_n.norm());
    truth.add(1e3 * f.way_m, f.true_n.norm());
    if (with_plane) plane.add(1e3 * f.way_m, f.plane_n.norm());
    way.add(1e3 * f.at[0], 1e3 * f.at[2]);
  }
  std::string lumps;
  for (const Shadow& l : shadows)
    lumps += fmt::format("set object circle at {},{} size {} fc rgb '#e0b070' fs solid noborder behind\n",
                         1e3 * l.x_m, 1e3 * l.z_m, 1e3 * l.radius_m);
  std::vector<Curve> curves;
  if (!stated.x.empty()) curves.push_back(stated);
  curves.insert(curves.end(), {felt_n, truth});
  if (with_plane) curves.push_back(plane);
  plot(file,
       "set multiplot layout 2,1\n" +
           script_of(curves, "set yrange [0:*]\nset key bottom right\n" +
                                 axes("Force along the way of the finger", "way (mm)", "force (N)")) +
           script_of({way}, "unset key\nset yrange [*:*]\nset size ratio -1\n" + lumps +
                                axes("The judged poses and the lumps, from above", "x (mm)", "z (mm)")) +
           "unset multiplot\n");
}

}  // namespace teletact::bench
