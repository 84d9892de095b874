// A finger of 120 mm/s over a hard ball, answered at 1 kHz in real time by the product's own session: what an
// answer takes of a processor, what its force is off by beside the converged contact at the same pose, and
// what it states.
#include <fmt/format.h>
#include <stdlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <thread>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/solid_blocks.h"
#include "bench/suites/solid/solid.h"
#include "service/contact/solid_contact.h"
#include "service/device/device.h"
#include "service/scene/tissue_models.h"
#include "service/touch_plane/touch_session.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

constexpr double kSpeedMS = 0.120, kPeriodS = 0.001, kIndentationM = 0.002;
constexpr double kWidthM = 0.112, kEndM = 0.024;  // given; z from -kEndM to kEndM
constexpr double kTruthError = 5e-5;              // stated, of the force that answers are held against

struct Sample {
  double time_s = 0, force_n = 0, error = 0, stated = 0;  // over the converged force
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Sample, time_s, force_n, error, stated)

struct Sweep {
  std::size_t nodes = 0;
  std::string path;
  double ball_m = 0;  // its centre's depth
  double answers_hz = 0, processor_p50_s = 0, processor_p99_s = 0;
  double late_p99_s = 0, late_max_s = 0;  // answers, beyond their millisecond
  double ok = 0;                          // share of the answers
  double within_1 = 0, within_2 = 0, covered = 0, stated_over_error_p50 = 0;  // of the samples
  std::vector<Sample> samples{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Sweep, nodes, path, ball_m, answers_hz, processor_p50_s, processor_p99_s,
                                   late_p99_s, late_max_s, ok, within_1, within_2, covered,
                                   stated_over_error_p50, samples)

struct Figures {
  double load_average = 0;  // when it began: other programs' if above 0
  std::vector<Sweep> sweeps{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, load_average, sweeps)

struct Path {
  const char* name;
  double lasts_s;
  std::array<double, 2> (*place_m)(double time_s);  // x, z from the ball
};
std::array<double, 2> along_line(double s) {
  return {-0.033 + kSpeedMS * s, 0.0013};
}
std::array<double, 2> along_circle(double s) {
  constexpr double kRadiusM = 0.005;
  return {kRadiusM * std::cos(kSpeedMS * s / kRadiusM), kRadiusM * std::sin(kSpeedMS * s / kRadiusM)};
}
std::array<double, 2> to_and_fro(double s) {  // a triangle, 2 Hz
  return {kSpeedMS / 4 * (std::abs(4 * (2 * s - std::floor(2 * s)) - 2) - 1) / 2, -0.0017};
}
constexpr std::array<Path, 3> kPaths{
    {{"line", 0.55, along_line}, {"circle", 1, along_circle}, {"reversals", 1, to_and_fro}}};

struct Mesh {
  double spacing_m;
  std::size_t layers, samples;
};
constexpr Mesh k70k{0.002, 34, 100}, k336k{0.001, 41, 40};

// A ball of contrast 10 in the middle; with what lies around it the block is solid_70k() or solid_336k().
service::ExplicitModulus volume(const Mesh& mesh, double ball_m) {
  service::ExplicitModulus e;
  e.x_m = service::uniform_coordinates(0, kWidthM, std::size_t(std::lround(kWidthM / mesh.spacing_m)));
  e.y_m = service::graded_rows(kSolidDepthM, mesh.layers, 1.03);
  e.z_m = service::uniform_coordinates(-kEndM, kEndM, std::size_t(std::lround(2 * kEndM / mesh.spacing_m)));
  const auto middle = [](const std::vector<double>& nodes, std::size_t n) {
    return (nodes[n] + nodes[n + 1]) / 2;
  };
  for (std::size_t k = 0; k + 1 < e.z_m.size(); ++k)
    for (std::size_t j = 0; j + 1 < e.y_m.size(); ++j)
      for (std::size_t i = 0; i + 1 < e.x_m.size(); ++i) {
        const double away =
            std::hypot(middle(e.x_m, i) - kWidthM / 2, middle(e.y_m, j) - ball_m, middle(e.z_m, k));
        e.youngs_modulus_pa.push_back(kSolidModulusPa * (away <= SolidLump{}.radius_m ? 10 : 1));
      }
  return e;
}

struct Answered {
  double time_s, processor_s, late_s, stated;
  service::Vector3 position_m, force_n;
  bool ok;
};

// In real time: an answer that is late leaves out those that were due meanwhile.
std::vector<Answered> answered(service::TouchSession& session, const Path& path) {
  const auto position = [&](double time_s) -> service::Vector3 {
    const auto [x, z] = path.place_m(time_s);
    return {kWidthM / 2 + x, kIndentationM, z};
  };
  service::Vector3 at = position(0);
  session.solve({at[0], -0.001, at[2]});
  session.solve(at);  // it lands
  std::vector<Answered> out;
  const auto begin = Clock::now();
  for (double due_s = kPeriodS; due_s < path.lasts_s;) {
    std::this_thread::sleep_until(begin + std::chrono::duration<double>(due_s));
    const double time_s = seconds_since(begin);
    at = position(time_s);
    service::TouchAnswer answer;
    const double processor_s = processor_seconds_of([&] { answer = session.solve(at); });
    if (answer.contact.state != service::ContactState::kContact)
      throw BenchError("no contact on the path: " + answer.warning);
    out.push_back({time_s, processor_s, seconds_since(begin) - due_s, answer.contact.solve.relative_error, at,
                   answer.contact.force_n, answer.status == service::TouchStatus::kOk});
    session.look_ahead();
    due_s = kPeriodS * std::max(std::round(due_s / kPeriodS) + 1, std::ceil(seconds_since(begin) / kPeriodS));
  }
  return out;
}

void judge(const std::vector<Answered>& answers, const service::SolidBlock& block,
           service::SolidContact<double>& exact, std::size_t samples, Sweep& sweep) {
  std::vector<double> processor, late, ratios;
  for (const Answered& a : answers) {
    processor.push_back(a.processor_s), late.push_back(std::max(0.0, a.late_s - kPeriodS));
    sweep.ok += double(a.ok) / double(answers.size());
  }
  const Quantiles time = quantiles(processor), beyond = quantiles(late);
  sweep.answers_hz = double(answers.size()) / answers.back().time_s;
  sweep.processor_p50_s = time.p50, sweep.processor_p99_s = time.p99;
  sweep.late_p99_s = beyond.p99, sweep.late_max_s = beyond.max;
  samples = std::min(samples, answers.size());
  for (std::size_t s = 0; s < samples; ++s) {
    const Answered& a = answers[(2 * s + 1) * answers.size() / (2 * samples)];
    const auto [x, y, z] = a.position_m;
    const service::Vector3 pose{x - block.origin_x_m, y, z - block.origin_z_m};
    const bool converged = exact.touch({}, pose, {.force_error = kTruthError}).solve.converged;
    const auto truth = exact.felt_answer({}, pose);
    if (!converged) throw BenchError("the force that answers are held against is not known");
    const Eigen::Vector3d f(a.force_n.data()), t(truth.force_n.data());
    const double error = (f - t).norm() / t.norm();
    sweep.samples.push_back({a.time_s, t.norm(), error, a.stated});
    ratios.push_back(a.stated / error);
    const auto count = [&](bool holds) { return double(holds) / double(samples); };
    sweep.within_1 += count(error <= 0.01), sweep.within_2 += count(error <= 0.02);
    sweep.covered += count(error <= a.stated);
  }
  sweep.stated_over_error_p50 = median_of(ratios);
}

void measure_mesh(const std::shared_ptr<service::Device>& device, const Mesh& mesh, bool quick, Figures& f) {
  service::SceneGeometry geometry;
  geometry.width_m = kWidthM, geometry.depth_m = kSolidDepthM;
  for (const double ball_m : {0.007, 0.012}) {
    const service::ExplicitModulus modulus = volume(mesh, ball_m);
    const service::SolidBlock block = service::solid_block(geometry, modulus);
    service::SolidContact<double> exact(device->queue(), block.tissue);
    for (const Path& path : kPaths) {
      const auto scene = std::make_shared<service::Scene>("sweep", geometry, modulus,
                                                          std::make_shared<service::VersionCounter>(nullptr));
      service::TouchSession session(scene, {.fingertip = {}, .path = service::SolvePath::kGradients}, device);
      Sweep sweep{block.tissue.grid.elements(), path.name, ball_m};
      judge(answered(session, path), block, exact, quick ? 20 : mesh.samples, sweep);
      std::printf(
          "%6zu nodes, ball %2.0f mm deep, %-9s: %4.0f Hz, %.3f ms of a processor (p99 %.2f), late by %4.1f "
          "ms "
          "(p99), OK %3.0f %%; within 1 %% %3.0f %%, 2 %% %3.0f %%; stated covers %3.0f %%, %.1f times the "
          "error\n",
          sweep.nodes, 1e3 * ball_m, path.name, sweep.answers_hz, 1e3 * sweep.processor_p50_s,
          1e3 * sweep.processor_p99_s, 1e3 * sweep.late_p99_s, 100 * sweep.ok, 100 * sweep.within_1,
          100 * sweep.within_2, 100 * sweep.covered, sweep.stated_over_error_p50);
      std::fflush(stdout);
      f.sweeps.push_back(std::move(sweep));
    }
    if (quick) return;
  }
}

void promise(const Figures& f, const Mesh& mesh, const char* name, Promises& promises) {
  std::vector<double> processor, ratios;
  double samples = 0, within_1 = 0, within_2 = 0, covered = 0, slowest_hz = HUGE_VAL;
  for (const Sweep& sweep : f.sweeps) {
    if ((sweep.nodes > 100'000) != (mesh.layers == k336k.layers)) continue;
    processor.push_back(sweep.processor_p50_s);
    slowest_hz = std::min(slowest_hz, sweep.answers_hz);
    for (const Sample& s : sweep.samples) {
      ratios.push_back(s.stated / s.error);
      ++samples, within_1 += s.error <= 0.01, within_2 += s.error <= 0.02, covered += s.error <= s.stated;
    }
  }
  const auto add = [&](const char* what, double value, double target, const char* unit, bool at_most) {
    promises.push_back({fmt::format("{}_{}", what, name), value, target, unit, at_most});
  };
  const bool fine = mesh.layers == k336k.layers;
  if (!fine) {
    add("processor_of_an_answer", median_of(processor), 0.3e-3, "s", true);
    add("within_1_percent", within_1 / samples, 0.95, "1", false);
  }
  add("within_2_percent", within_2 / samples, fine ? 0.95 : 0.99, "1", false);
  add("stated_error_covers", covered / samples, 0.95, "1", false);
  add("stated_over_true_error_median", median_of(ratios), 8, "1", true);
  add("slowest_answers", slowest_hz, 950, "Hz", false);
}

Figures measure(bool quick, Promises& promises) {
  const auto device = service::Device::open();
  Figures f;
  getloadavg(&f.load_average, 1);
  measure_mesh(device, k70k, quick, f);
  promise(f, k70k, "70k", promises);
  if (quick) return f;
  measure_mesh(device, k336k, quick, f);
  promise(f, k336k, "336k", promises);
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  for (const Sweep& sweep : f.sweeps) {
    Curve error{.title = "off by", .ours = true}, stated{.title = "stated"};
    for (const Sample& s : sweep.samples) error.add(s.time_s, s.error), stated.add(s.time_s, s.stated);
    const double depth_mm = 1e3 * sweep.ball_m;
    plot(folder / fmt::format("solid_sweep_{}_{}_{:.0f}mm.png", sweep.nodes, sweep.path, depth_mm),
         script_of({error, stated}, "set logscale y\nset format y '10^{%L}'\n" +
                                        axes(fmt::format("{} nodes, a ball {:.0f} mm deep, {}", sweep.nodes,
                                                         depth_mm, sweep.path),
                                             "time (s)", "of the force")));
  }
}

}  // namespace

Part solid_sweep() {
  return make_part("sweep", measure, draw);
}

}  // namespace teletact::bench
