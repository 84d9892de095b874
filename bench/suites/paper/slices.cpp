// The source paper's second strategy, its first half (T8.7): a volume with two lumps becomes touchable slice
// by slice. Moduli are given. What a finger's path feels after each slice beside the whole volume's truth,
// and how soon a slice is touched while a finger presses.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <thread>

#include "bench/curves.h"
#include "bench/suites/paper/paper.h"
#include "service/device/device.h"
#include "service/touch_plane/touch_session.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kWidthM = 0.112, kDepthM = 0.040, kEndM = 0.024;  // z from -kEndM to kEndM
constexpr double kBackgroundPa = 10e3, kIndentationM = 0.002;
constexpr std::size_t kSlices = 31, kPoses = 33;
constexpr double kTouchable70k = 0.005, kTouchable336k = 0.025, kForceError = 0.01;

struct Lump {
  double x_m, y_m, z_m, radius_m, contrast;
};
constexpr std::array<Lump, 2> kLumps{{{0.036, 0.012, -0.008, 0.006, 5}, {0.076, 0.010, 0.009, 0.005, 3}}};

double modulus_pa(double x_m, double y_m, double z_m) {
  double e = kBackgroundPa;
  for (const Lump& l : kLumps)
    if (std::hypot(x_m - l.x_m, y_m - l.y_m, z_m - l.z_m) < l.radius_m) e *= l.contrast;
  return e;
}

// Nodes of the volume; with what lies around it 64 x 32 columns of 2 mm, or 128 x 64 of 1 mm.
service::ExplicitModulus volume(double spacing_m, std::size_t layers) {
  service::ExplicitModulus e;
  e.x_m = service::uniform_coordinates(0, kWidthM, std::size_t(std::lround(kWidthM / spacing_m)));
  e.y_m = service::graded_rows(kDepthM, layers, 1.03);
  e.z_m = service::uniform_coordinates(-kEndM, kEndM, std::size_t(std::lround(2 * kEndM / spacing_m)));
  return e;
}

std::vector<double> plane_of(const service::ExplicitModulus& e, double z_m) {
  std::vector<double> plane;
  for (std::size_t j = 0; j + 1 < e.y_m.size(); ++j)
    for (std::size_t i = 0; i + 1 < e.x_m.size(); ++i)
      plane.push_back(modulus_pa((e.x_m[i] + e.x_m[i + 1]) / 2, (e.y_m[j] + e.y_m[j + 1]) / 2, z_m));
  return plane;
}
double slice_z_m(std::size_t n) {
  return -kEndM + 2 * kEndM * double(n) / double(kSlices - 1);
}
service::ModulusSlice slice(const service::ExplicitModulus& e, std::size_t n) {
  return {slice_z_m(n), {}, {}, plane_of(e, slice_z_m(n))};
}

std::shared_ptr<service::Scene> scene_of(service::ExplicitModulus e) {
  service::SceneGeometry geometry;
  geometry.width_m = kWidthM, geometry.depth_m = kDepthM;
  return std::make_shared<service::Scene>("slices", geometry, std::move(e),
                                          std::make_shared<service::VersionCounter>(nullptr));
}
// Of the first slice alone.
std::shared_ptr<service::Scene> growing(const service::ExplicitModulus& e) {
  return scene_of(service::stacked(e, {slice(e, 0)}, {}));
}

// Across both lumps.
service::Vector3 pose(std::size_t n) {
  const double share = double(n) / double(kPoses - 1);
  return {0.016 + 0.080 * share, kIndentationM, -0.0165 + 0.034 * share};
}
std::vector<double> along_path(service::TouchSession& finger) {
  std::vector<double> force_n;
  for (std::size_t n = 0; n < kPoses; ++n) {
    const service::TouchAnswer answer = finger.solve(pose(n));
    if (answer.contact.state != service::ContactState::kContact)
      throw BenchError("no contact on the path: " + answer.warning);
    force_n.push_back(-answer.contact.force_n[1]);
  }
  return force_n;
}

struct PathFigures {
  std::size_t slices = 0;
  std::vector<double> force_n;
  double error_p50 = 0, error_p95 = 0;  // of all poses, over the truth's force
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PathFigures, slices, force_n, error_p50, error_p95)
struct TimeFigures {
  std::size_t nodes = 0;
  std::vector<double> touchable_s, answered_s;  // of each slice: since its modulus was there
  Quantiles touchable{}, answered{};
  double longest_gap_s = 0, renewal_s = 0;  // between answers; of the factor, the slowest
  std::size_t renewals = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(TimeFigures, nodes, touchable_s, answered_s, touchable, answered,
                                   longest_gap_s, renewal_s, renewals)
struct Figures {
  std::vector<double> path_x_m{}, truth_n{};
  std::vector<PathFigures> path{};
  std::vector<TimeFigures> times{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, path_x_m, truth_n, path, times)

const service::TouchOptions kByNodes{.fingertip = {}, .path = service::SolvePath::kGradients};

void feel_path(const std::shared_ptr<service::Device>& device, bool quick, Figures& figures) {
  const service::ExplicitModulus grid = volume(0.002, 34);
  service::ExplicitModulus whole = grid;
  for (std::size_t k = 0; k + 1 < grid.z_m.size(); ++k) {
    const std::vector<double> plane = plane_of(grid, (grid.z_m[k] + grid.z_m[k + 1]) / 2);
    whole.youngs_modulus_pa.insert(whole.youngs_modulus_pa.end(), plane.begin(), plane.end());
  }
  service::TouchSession true_finger(scene_of(std::move(whole)), kByNodes, device);
  figures.truth_n = along_path(true_finger);
  for (std::size_t n = 0; n < kPoses; ++n) figures.path_x_m.push_back(pose(n)[0]);
  const auto scene = growing(grid);
  service::TouchSession finger(scene, kByNodes, device);
  for (std::size_t slices = 1;; ++slices) {
    show_progress(fmt::format("slice {} of {}", slices, kSlices));
    if (!quick || slices % 10 == 1) {
      PathFigures felt{slices, along_path(finger)};
      std::vector<double> error;
      for (std::size_t n = 0; n < kPoses; ++n)
        error.push_back(std::abs(felt.force_n[n] / figures.truth_n[n] - 1));
      const Quantiles q = quantiles(error);
      felt.error_p50 = q.p50, felt.error_p95 = q.p95;
      std::printf("  %2zu slices: force off by %5.2f %% (median), %5.2f %% (p95)\n", slices, 100 * q.p50,
                  100 * q.p95);
      figures.path.push_back(std::move(felt));
    }
    if (slices == kSlices) return;
    scene->publish(slice(grid, slices));
    if (const auto renewed = scene->renewed()) scene->renew(*renewed);
  }
}

// A finger rests pressed over a lump meanwhile.
TimeFigures time_slices(const std::shared_ptr<service::Device>& device, double spacing_m,
                        std::size_t layers) {
  const service::ExplicitModulus grid = volume(spacing_m, layers);
  const service::Vector3 at{kLumps[0].x_m, kIndentationM, kLumps[0].z_m};
  {  // the kernels of a correction are compiled before
    service::TouchSession warm(scene_of(service::stacked(grid, {slice(grid, 10)}, {})), kByNodes, device);
    warm.solve(at);
  }
  const auto scene = growing(grid);
  service::TouchSession session(scene, kByNodes, device);
  session.solve(at);
  TimeFigures out;
  std::atomic<bool> stop{false};
  std::map<std::uint64_t, Clock::time_point> first;
  std::thread finger([&] {
    Clock::time_point last = Clock::now();
    while (!stop) {
      const std::uint64_t version = session.solve(at).model_version;
      const Clock::time_point now = Clock::now();
      first.emplace(version, now);
      out.longest_gap_s = std::max(out.longest_gap_s, std::chrono::duration<double>(now - last).count());
      last = now;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  std::vector<std::pair<std::uint64_t, Clock::time_point>> came;
  for (std::size_t n = 1; n < kSlices; ++n) {
    show_progress(fmt::format("{} layers: slice {} of {}", layers, n + 1, kSlices));
    const service::ModulusSlice next = slice(grid, n);
    const Clock::time_point arrived = Clock::now();
    const service::Published published = scene->publish(next);
    out.touchable_s.push_back(std::chrono::duration<double>(Clock::now() - arrived).count());
    came.emplace_back(published.version, arrived);
    std::this_thread::sleep_for(std::chrono::milliseconds(spacing_m < 0.002 ? 500 : 150));
    const Clock::time_point begun = Clock::now();
    const auto renewed = scene->renewed();
    if (!renewed) continue;
    scene->renew(*renewed);
    ++out.renewals;
    out.renewal_s = std::max(out.renewal_s, std::chrono::duration<double>(Clock::now() - begun).count());
    std::this_thread::sleep_for(std::chrono::milliseconds(spacing_m < 0.002 ? 500 : 150));
  }
  stop = true;
  finger.join();
  for (const auto& [version, arrived] : came)
    if (first.contains(version))
      out.answered_s.push_back(std::chrono::duration<double>(first[version] - arrived).count());
  out.nodes = 64 * 32 * (layers + 1) * (spacing_m < 0.002 ? 4 : 1);
  out.touchable = quantiles(out.touchable_s), out.answered = quantiles(out.answered_s);
  std::printf(
      "  %zu nodes: touchable p50 %.2f ms, p95 %.2f ms; answered p50 %.0f ms, p95 %.0f ms; longest "
      "gap %.0f ms; factor renewed %zu times, at most %.0f ms\n",
      out.nodes, 1e3 * out.touchable.p50, 1e3 * out.touchable.p95, 1e3 * out.answered.p50,
      1e3 * out.answered.p95, 1e3 * out.longest_gap_s, out.renewals, 1e3 * out.renewal_s);
  return out;
}

Figures measure(bool quick, Promises& promises) {
  const auto device = service::Device::open();
  Figures figures;
  std::printf("\na volume with two lumps, slice by slice\n");
  feel_path(device, quick, figures);
  figures.times.push_back(time_slices(device, 0.002, 34));
  if (!quick) figures.times.push_back(time_slices(device, 0.001, 41));
  const PathFigures& all = figures.path.back();
  promises.push_back({"force_of_all_slices_off_the_volumes_p50", all.error_p50, kForceError});
  promises.push_back(
      {"slice_touchable_at_70k_nodes_p50", figures.times[0].touchable.p50, kTouchable70k, "s"});
  if (!quick)
    promises.push_back(
        {"slice_touchable_at_336k_nodes_p50", figures.times[1].touchable.p50, kTouchable336k, "s"});
  return figures;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  std::vector<Curve> forces;
  for (const PathFigures& path : figures.path) {
    if (path.slices % 6 != 1) continue;
    forces.push_back(
        {.title = fmt::format("{} slices", path.slices),
         .style = fmt::format("lines lw 2 lc palette frac {:.3f}", double(path.slices) / double(kSlices))});
    for (std::size_t n = 0; n < path.force_n.size(); ++n)
      forces.back().add(1e3 * figures.path_x_m[n], path.force_n[n]);
  }
  Curve truth{.title = "the whole volume", .style = "points pt 6 ps 1.2 lc rgb 'black'"};
  for (std::size_t n = 0; n < figures.truth_n.size(); ++n)
    truth.add(1e3 * figures.path_x_m[n], figures.truth_n[n]);
  forces.push_back(truth);
  plot(folder / "slices_force.png",
       script_of(forces,
                 "set yrange [0:]\nset key outside right\nunset colorbox\n"
                 "set palette defined (0 '#bcd6ee', 1 '#08306b')\n" +
                     axes("A volume with two lumps becomes touchable slice by slice (the paper's "
                          "second strategy)\\nalong a path over both, 2 mm deep",
                          "x (mm)", "force (N)")));
  Curve median{.title = "median of the path", .ours = true}, most{.title = "p95"};
  for (const PathFigures& path : figures.path) {
    median.add(double(path.slices), 100 * path.error_p50);
    most.add(double(path.slices), 100 * path.error_p95);
  }
  plot(folder / "slices_error.png",
       script_of({median, most}, axes("Force off the whole volume's", "slices", "% of the force")));
}

}  // namespace

Part paper_slices() {
  return make_part("slices", measure, draw);
}

}  // namespace teletact::bench
