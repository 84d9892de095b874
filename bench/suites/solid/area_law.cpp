// The contact law over 60 x 60 mm of solid tissue with a hard ball, as the service samples it: how long the
// guess takes and its correction, and what either is off by beside the converged contact at random poses.
#include <fmt/format.h>
#include <stdlib.h>

#include <cmath>
#include <cstdio>
#include <random>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/solid_blocks.h"
#include "bench/suites/solid/solid.h"
#include "common/contact_law.h"
#include "service/contact/area_sampler.h"
#include "service/contact/solid_contact.h"
#include "service/device/device.h"
#include "service/scene/tissue_models.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

constexpr double kWidthM = 0.060, kSpacingM = 0.002, kTruthError = 5e-4;
constexpr double kShallowestM = 5e-4, kDeepestM = 4e-3;  // of the poses
constexpr std::size_t kLayers = 34;

struct Judged {
  double within_s = 0;     // from the beginning
  std::size_t solves = 0;  // contacts answered until then
  double error_p50 = 0, error_p95 = 0, error_max = 0, covered = 0, stated_over_error_p50 = 0;
  std::vector<double> errors{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Judged, within_s, solves, error_p50, error_p95, error_max, covered,
                                   stated_over_error_p50, errors)

struct OfBall {
  double depth_m = 0;
  std::size_t nodes = 0, columns = 0;
  Judged guess{}, corrected{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(OfBall, depth_m, nodes, columns, guess, corrected)

struct Figures {
  double load_average = 0;  // when it began: other programs' if above 0
  std::vector<OfBall> balls{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, load_average, balls)

// A ball of contrast 10 below the middle.
service::ExplicitModulus volume(double ball_m) {
  service::ExplicitModulus e;
  const auto cells = std::size_t(std::lround(kWidthM / kSpacingM));
  e.x_m = service::uniform_coordinates(0, kWidthM, cells);
  e.y_m = service::graded_rows(kSolidDepthM, kLayers, 1.03);
  e.z_m = service::uniform_coordinates(0, kWidthM, cells);
  const auto middle = [](const std::vector<double>& nodes, std::size_t n) {
    return (nodes[n] + nodes[n + 1]) / 2;
  };
  for (std::size_t k = 0; k < cells; ++k)
    for (std::size_t j = 0; j < kLayers; ++j)
      for (std::size_t i = 0; i < cells; ++i) {
        const double away = std::hypot(middle(e.x_m, i) - kWidthM / 2, middle(e.y_m, j) - ball_m,
                                       middle(e.z_m, k) - kWidthM / 2);
        e.youngs_modulus_pa.push_back(kSolidModulusPa * (away <= SolidLump{}.radius_m ? 10 : 1));
      }
  return e;
}

struct Truth {
  service::Vector3 position_m;
  Eigen::Vector3d force_n;
};

// Anywhere, and half of them above the ball, where there is something to feel.
std::vector<Truth> truths(const service::SolidBlock& block, service::SolidContact<double>& exact,
                          std::size_t count) {
  std::mt19937 random(5);
  const auto between = [&](double a, double b) { return std::uniform_real_distribution(a, b)(random); };
  std::vector<Truth> out;
  while (out.size() < count) {
    const double aside = out.size() % 2 ? 0.012 : kWidthM / 2 - 0.001;
    const service::Vector3 at{kWidthM / 2 + between(-aside, aside), between(kShallowestM, kDeepestM),
                              kWidthM / 2 + between(-aside, aside)};
    const service::Vector3 pose{at[0] - block.origin_x_m, at[1], at[2] - block.origin_z_m};
    const bool converged = exact.touch({}, pose, {.force_error = kTruthError}).solve.converged;
    const auto answer = exact.felt_answer({}, pose);
    if (!converged) throw BenchError("the force that laws are held against is not known");
    out.push_back({at, Eigen::Vector3d(answer.force_n.data())});
  }
  return out;
}

Judged judge(const std::vector<LawColumn>& columns, const std::vector<Truth>& truths) {
  Judged judged;
  std::vector<double> ratios;
  for (const Truth& t : truths) {
    const auto [x, d, z] = t.position_m;
    const LawValue value = evaluate(columns, x, d, z);
    if (!value.covered || value.beyond)
      throw BenchError(fmt::format("the law does not cover x {}, z {}, d {}", x, z, d));
    const Eigen::Vector3d f(-value.by_x_n, -value.by_d_n, -value.by_z_n);
    const double off_n = (f - t.force_n).norm();
    judged.errors.push_back(off_n / t.force_n.norm());
    ratios.push_back(value.error_n / off_n);
    judged.covered += double(off_n <= value.error_n) / double(truths.size());
  }
  const Quantiles errors = quantiles(judged.errors);
  judged.error_p50 = errors.p50, judged.error_p95 = errors.p95, judged.error_max = errors.max;
  judged.stated_over_error_p50 = median_of(ratios);
  return judged;
}

void say(const OfBall& ball, const char* what, const Judged& judged) {
  std::printf(
      "law: %zu nodes, ball %2.0f mm deep, %3zu columns, %-9s after %6.2f s, %4zu contacts: off by %.2f %% "
      "(median), %.2f %% (95 %%), %.1f %% (most); stated covers %3.0f %%, %.1f times the error\n",
      ball.nodes, 1e3 * ball.depth_m, ball.columns, what, judged.within_s, judged.solves,
      100 * judged.error_p50, 100 * judged.error_p95, 100 * judged.error_max, 100 * judged.covered,
      judged.stated_over_error_p50);
  std::fflush(stdout);
}

OfBall measure_ball(const std::shared_ptr<service::Device>& device, double ball_m, std::size_t poses) {
  service::SceneGeometry geometry;
  geometry.width_m = kWidthM, geometry.depth_m = kSolidDepthM;
  const service::SolidBlock block = service::solid_block(geometry, volume(ball_m));
  service::SolidContact<double> exact(device->queue(), block.tissue);
  const std::vector<Truth> held = truths(block, exact, poses);
  const service::SolidTouchModel model(block, {});
  service::TouchWay way;
  way.device = device;
  way.path = service::SolvePath::kGradients;
  way.law = true;
  const auto layer = model.layer({}, way, {});
  OfBall ball{ball_m, block.tissue.grid.elements()};
  // The finger rests in the middle.
  service::AreaSampler sampler(layer, {}, {}, block.region, {kWidthM / 2, 0, kWidthM / 2});
  const auto begin = Clock::now();
  while (!sampler.guessed()) sampler.advance(Clock::now());
  const double guessed_s = seconds_since(begin);
  ball.columns = sampler.columns().size();
  const std::size_t guesses = sampler.solves();
  ball.guess = judge(sampler.columns(), held);
  ball.guess.within_s = guessed_s, ball.guess.solves = guesses;
  say(ball, "guess", ball.guess);
  const auto corrects = Clock::now();
  sampler.advance(Clock::time_point::max());
  const double corrected_s = seconds_since(corrects);
  ball.corrected = judge(sampler.columns(), held);
  ball.corrected.within_s = guessed_s + corrected_s, ball.corrected.solves = sampler.solves();
  say(ball, "corrected", ball.corrected);
  return ball;
}

Figures measure(bool quick, Promises& promises) {
  const auto device = service::Device::open();
  Figures f;
  getloadavg(&f.load_average, 1);
  std::vector<double> guesses, corrected;
  double guess_s = 0, corrected_s = 0, covered = 0, all = 0;
  for (const double ball_m : {0.007, 0.012}) {
    f.balls.push_back(measure_ball(device, ball_m, quick ? 20 : 200));
    const OfBall& ball = f.balls.back();
    guesses.insert(guesses.end(), ball.guess.errors.begin(), ball.guess.errors.end());
    corrected.insert(corrected.end(), ball.corrected.errors.begin(), ball.corrected.errors.end());
    guess_s = std::max(guess_s, ball.guess.within_s),
    corrected_s = std::max(corrected_s, ball.corrected.within_s);
    covered += ball.corrected.covered + ball.guess.covered, all += 2;
    if (quick) break;
  }
  const auto add = [&](const char* what, double value, double target, const char* unit, bool at_most = true) {
    promises.push_back({what, value, target, unit, at_most});
  };
  add("law_guessed", guess_s, 0.5, "s");
  add("law_corrected", corrected_s, 10, "s");
  add("law_error_median", quantiles(corrected).p50, 0.01, "1");
  add("law_error_p95", quantiles(corrected).p95, 0.03, "1");
  add("law_stated_covers", covered / all, 0.95, "1", false);
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  for (const OfBall& ball : f.balls) {
    const auto curve = [](const char* title, std::vector<double> errors, bool ours) {
      std::ranges::sort(errors);
      Curve out{.title = title, .ours = ours};
      for (std::size_t i = 0; i < errors.size(); ++i)
        out.add(errors[i], double(i + 1) / double(errors.size()));
      return out;
    };
    const double depth_mm = 1e3 * ball.depth_m;
    plot(
        folder / fmt::format("solid_law_{:.0f}mm.png", depth_mm),
        script_of({curve("guess", ball.guess.errors, false), curve("corrected", ball.corrected.errors, true)},
                  "set logscale x\nset format x '10^{%L}'\n" +
                      axes(fmt::format("law over 60 x 60 mm, a ball {:.0f} mm deep", depth_mm),
                           "off by, of the force", "share of the poses")));
  }
}

}  // namespace

Part solid_law() {
  return make_part("law", measure, draw);
}

}  // namespace teletact::bench
