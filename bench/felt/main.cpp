// teletact-felt: the forces that were felt in a touch of a simulated solid patient, beside those
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

#include "bench/felt/felt_summary.h"
#include "bench/felt/patient_truth.h"
#include "bench/independent/touched_block.h"
#include "bench/suite.h"
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
#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

using client::SolidPatient;
using Eigen::Vector3d;
using nlohmann::json;

constexpr int kPromisesMissed = 2;   // exit code, as of teletact-client report
constexpr double kMinForceN = 0.05;  // a force that is felt is more
constexpr double kForceMedian = 0.02, kCoverage = 0.90;
// From RF: the force, and how much of the path a stated interval of 95 % holds.
constexpr double kForceMedianFromRf = 0.10, kHeldAtLeast = 0.90;

struct Options {
  std::string touch_record, out;
  std::uint64_t seed = 1;
  std::string tissue, modulus, log_std, acquire_record;  // of a patient that was imaged
  std::size_t poses = 60, poses_by_20_nodes = 0;
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

// In the middle of each of so many parts of the path.
std::vector<FeltPose> chosen(const client::TouchRecord& touch, const std::vector<client::TouchTick>& path,
                             std::size_t count) {
  const auto first = std::find_if(path.begin(), path.end(), pressed);
  const auto last = std::find_if(path.rbegin(), path.rend(), pressed).base();
  if (first >= last) throw BenchError("the finger never pressed the tissue: there is no force to judge");
  const double begin_s = first->time_s, part_s = ((last - 1)->time_s - begin_s) / double(count);
  std::vector<FeltPose> out;
  double way_m = 0, next_s = part_s / 2;
  for (auto tick = first; tick != last && out.size() < count; ++tick) {
    if (tick != first) way_m += std::hypot(tick->x_m - (tick - 1)->x_m, tick->z_m - (tick - 1)->z_m);
    const double time_s = tick->time_s - begin_s;
    if (!pressed(*tick) || time_s < next_s) continue;
    next_s = part_s > 0 ? (std::floor(time_s / part_s) + 1.5) * part_s : 0;
    FeltPose& f = out.emplace_back();
    f.time_s = time_s, f.way_m = way_m, f.at = {tick->x_m, tick->indentation_m, tick->z_m};
    f.felt_n = Vector3d(tick->force_x_n, tick->force_y_n, tick->force_z_n);
    if (const auto stated = client::stated_interval(touch, *tick)) f.half_width = stated->half_width;
  }
  return out;
}

// Of the pressed path: the share that had a force.
double coverage_of(const std::vector<client::TouchTick>& path) {
  const auto owed = std::ranges::count_if(path, pressed);
  const auto felt = std::ranges::count_if(path, [](const client::TouchTick& tick) {
    return pressed(tick) && tick.enabled && -tick.force_y_n > kMinForceN;
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
           std::vector<FeltPose>& felt) {
  const auto device = service::Device::open();
  PatientTruth truth(device->queue(), solid, tip);
  for (std::size_t n = 0; n < felt.size(); ++n) {
    show_progress(fmt::format("pose {} of {}", n + 1, felt.size()));
    FeltPose& f = felt[n];
    const auto [force_n, nodes] = truth.at(f.at);
    f.true_n = force_n, f.truths_nodes = nodes;
    if (plane) f.plane_n = plane_force(device, *plane, tip, f.at);
  }
}

// At so many of the poses, evenly among them.
void solve_by_20_nodes(const TrueSolid& solid, const service::Fingertip& tip, std::size_t count,
                       std::vector<FeltPose>& felt) {
  for (std::size_t k = 0; k < count; ++k) {
    show_progress(fmt::format("by elements of 20 nodes: pose {} of {}", k + 1, count));
    FeltPose& f = felt[(2 * k + 1) * felt.size() / (2 * count)];
    const double x_m = f.at[0], z_m = f.at[2];
    f.by_20_nodes_n = round_touch_n(
        {tip.radius_m,
         f.at[1],
         solid.depth_m,
         solid.poisson_ratio,
         solid.bed_m,
         solid.slides,
         {solid.sides.left_m - x_m, solid.sides.right_m - x_m, solid.sides.near_m - z_m,
          solid.sides.far_m - z_m},
         [&](const Hexahedra::Point& p) { return solid.modulus_pa(x_m + p.x(), p.y(), z_m + p.z()); }});
  }
}

// What a touch was, and where it is judged.
struct Judged {
  client::TouchRecord touch;
  std::vector<client::TouchTick> path;
  double coverage = 0;
  service::Fingertip tip;
  std::vector<FeltPose> felt;
};

Judged judged(const Options& options) {
  Judged j;
  j.touch = client::read_touch_record(options.touch_record);
  j.path = client::felt_path(j.touch.ticks);
  j.coverage = coverage_of(j.path);
  j.tip = tip_of(j.touch);
  j.felt = chosen(j.touch, j.path, options.poses);
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
  const TrueSolid solid = true_solid(tissue);
  if (options.poses_by_20_nodes > 0 && j.tip.shape != service::FingertipShape::kRoundedTip)
    throw BenchError("--poses-by-20-nodes: a round tip alone");
  if (options.poses_by_20_nodes > j.felt.size())
    throw BenchError(fmt::format("--poses-by-20-nodes: {} are more than the {} that are judged",
                                 options.poses_by_20_nodes, j.felt.size()));
  solve(solid, nullptr, j.tip, j.felt);
  solve_by_20_nodes(solid, j.tip, options.poses_by_20_nodes, j.felt);
  json summary = judge(client::summarise(j.touch, TELETACT_VERSION), j.felt, j.coverage);
  judge_by_20_nodes(summary, j.felt);
  judge_intervals(summary, j.felt);
  judge_slices(summary, acquire, j.path);
  judge_lumps(summary, volume, tissue);
  if (!options.log_std.empty()) judge_top(summary, volume, client::read_metaimage(options.log_std), tissue);
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
}  // namespace teletact::bench

int main(int argc, char** argv) {
  CLI::App app(
      "a touch of a simulated solid patient beside that patient's own tissue; exit code 2 when a promise is "
      "missed",
      "teletact-felt");
  app.set_version_flag("--version", "teletact-felt " TELETACT_VERSION);
  app.option_defaults()->always_capture_default();
  teletact::bench::Options options;
  app.add_option("--touch-record", options.touch_record, "written by teletact-client touch --record")
      ->required();
  app.add_option("--seed", options.seed, "of the patient that was touched: teletact-client slices");
  CLI::Option* tissue = app.add_option("--tissue", options.tissue,
                                       "instead: the solid that acquire --slices imaged, as it saved it");
  app.get_option("--seed")->excludes(tissue);
  CLI::Option* modulus =
      app.add_option("--modulus", options.modulus, "with it: the volume that acquire saved")->needs(tissue);
  CLI::Option* record =
      app.add_option("--acquire-record", options.acquire_record, "with it: written by acquire --record")
          ->needs(tissue);
  tissue->needs(modulus)->needs(record);
  app.add_option("--log-std", options.log_std, "with --modulus: its deviations, as acquire saved them")
      ->needs(modulus);
  app.add_option("--poses", options.poses, "so many are judged, evenly over the touch")
      ->check(CLI::Range(1, 100000));
  app.add_option("--poses-by-20-nodes", options.poses_by_20_nodes,
                 "with --tissue: so many are solved by elements of 20 nodes, too; minutes each")
      ->needs(tissue);
  app.add_option("--out", options.out, "folder for summary.json and the pictures")->required();
  try {
    app.parse(argc, argv);
    return teletact::bench::run(options) ? 0 : teletact::bench::kPromisesMissed;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "teletact-felt: %s\n", error.what());
    return 1;
  }
}
