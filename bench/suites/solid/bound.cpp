// What is certified (T8.3) over the true error, at every iteration of touches of random lumps and textures;
// in float, the error below which it does not hold.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <random>

#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/suites/solid/solid.h"
#include "bench/suites/solid/truth.h"

namespace teletact::bench {
namespace {

struct Float {
  double poisson_ratio = 0, contrast = 0;
  double floor = 0;        // largest true error that exceeds what is certified for it
  double least_error = 1;  // that was reached
  double said_from = 0;    // the true error when the solver first says that its bound is broken; 0: never
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Float, poisson_ratio, contrast, floor, least_error, said_from)

struct Figures {
  std::size_t tissues = 0, touches = 0, iterations = 0, broken = 0;
  double worst = HUGE_VAL;  // certified over true: the least
  double median = 0, p95 = 0, most = 0;
  std::vector<double> ratios{};  // by rank, 200 of them
  std::vector<Float> in_float{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, tissues, touches, iterations, broken, worst, median, p95, most,
                                   ratios, in_float)

service::SolidGrid grid() {
  return solid_grid(32, 16, 13, 0.004, 0.004);
}

// Soft and stiff lumps anywhere, with and without texture; pushed with and without a skin, or loaded.
struct Draw {
  std::mt19937_64 engine;
  double uniform(double low, double high) { return low + (high - low) * double(engine() >> 11) * 0x1p-53; }
  service::SolidTissue tissue() {
    constexpr std::array kRatios{0.3, 0.49, 0.4999};
    const double nu = kRatios[engine() % kRatios.size()];
    const double texture = engine() % 2 ? uniform(0.05, 0.3) : 0;
    const SolidLump lump{std::exp(uniform(std::log(0.1), std::log(1000))),
                         {uniform(-0.03, 0.03), uniform(0.003, 0.03), uniform(-0.02, 0.02)},
                         uniform(0.004, 0.015)};
    return solid_tissue(grid(), nu, lump, texture, engine());
  }
  SolidTouch touch() {
    SolidTouch t;
    t.pushed = engine() % 4 != 0;
    t.skin_m_n = engine() % 2 ? std::exp(uniform(std::log(1e-4), std::log(1e-1))) : 0;
    const double x = uniform(-0.04, 0.04), z = uniform(-0.02, 0.02);
    t.surface = paraboloid_push(grid(), x, z, uniform(0.004, 0.010));
    return t;
  }
};

// Calls see(true error, certified error, solution), both of the energy norm over |u|, for iterations 0, 1 ...
// until it returns false.
template <class T, class See>
void each_iteration(service::SolidSolver<T>& solver, const SolidTruth& truth, const SolidTouch& touch,
                    See&& see) {
  for (std::size_t k = 0;; ++k) {
    const service::SolidSolution s = touch.solve(solver, {.relative_error = 0, .max_iterations = k});
    if (s.reason != service::StopReason::kIterationLimit && s.reason != service::StopReason::kConverged)
      return;
    if (!see(std::sqrt(truth.squared_error(solver, s)), std::sqrt(2 * s.energy_error_j / truth.energy()), s))
      return;
  }
}

void measure_double(const service::Queue& queue, bool quick, Figures& f) {
  Draw draw{std::mt19937_64(20261121)};
  const std::size_t tissues = quick ? 6 : 100, touches = quick ? 3 : 10;
  std::vector<double> ratios;
  for (std::size_t t = 0; t < tissues; ++t) {
    const service::SolidTissue tissue = draw.tissue();
    const Eigen::SparseMatrix<double> k = reference::assemble(tissue);
    service::SolidSolver<double> solver(queue, tissue);
    for (std::size_t n = 0; n < touches; ++n) {
      const SolidTouch touch = draw.touch();
      const SolidTruth truth(k, solver, touch);
      ++f.touches;
      each_iteration(solver, truth, touch, [&](double error, double certified, const auto&) {
        if (error < 1e-6) return false;
        // The truth itself is off by its own certified error.
        f.broken += certified + 2 * SolidTruth::kError < error;
        ratios.push_back(certified / error);
        return true;
      });
    }
    show_progress("tissue " + std::to_string(t));
  }
  std::sort(ratios.begin(), ratios.end());
  const auto at = [&](double share) { return ratios[std::size_t(share * double(ratios.size() - 1))]; };
  f.tissues = tissues, f.iterations = ratios.size();
  f.worst = at(0), f.median = at(0.5), f.p95 = at(0.95), f.most = at(1);
  for (int k = 0; k < 200; ++k) f.ratios.push_back(at(k / 199.0));
  std::printf(
      "bound: %zu touches, %zu iterations: broken in %zu; certified over true error: least %.6f, median "
      "%.3f, 95 %% %.2f, most %.2f\n",
      f.touches, f.iterations, f.broken, f.worst, f.median, f.p95, f.most);
}

Float measure_float(const service::Queue& queue, double nu, double contrast) {
  const service::SolidTissue tissue = solid_tissue(grid(), nu, {.contrast = contrast});
  const Eigen::SparseMatrix<double> k = reference::assemble(tissue);
  service::SolidSolver<double> exact(queue, tissue);
  service::SolidSolver<float> solver(queue, tissue);
  Float out{nu, contrast};
  for (const double x : {0.0, 0.007}) {
    const SolidTouch touch{paraboloid_push(grid(), x, 0.003, 0.008), true, 0};
    const SolidTruth truth(k, exact, touch);
    constexpr std::size_t kBeyond = 10;  // iterations after it was broken
    std::size_t after = 0;
    each_iteration(solver, truth, touch,
                   [&](double error, double certified, const service::SolidSolution& s) {
                     out.least_error = std::min(out.least_error, error);
                     if (certified < error) out.floor = std::max(out.floor, error), ++after;
                     if (!s.certified && out.said_from == 0) out.said_from = error;
                     return after < kBeyond && s.iterations < 150;
                   });
  }
  std::printf("bound in float: nu %-6g contrast %-4g broken below %.1e, said from %.1e on, reached %.1e\n",
              nu, contrast, out.floor, out.said_from, out.least_error);
  return out;
}

Figures measure(bool quick, Promises& promises) {
  const service::Queue queue = service::Device::open()->queue();
  Figures f;
  measure_double(queue, quick, f);
  for (const double nu : {0.3, 0.49, 0.4999})
    for (const double contrast : {10.0, 1000.0})
      if (!quick || contrast == 10) f.in_float.push_back(measure_float(queue, nu, contrast));
  promises.push_back({"iterations_where_the_bound_is_broken", double(f.broken), 0});
  promises.push_back({"certified_over_true_error_median", f.median, 2});
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  Curve curve{.title = "", .ours = true, .style = "lines lw 3"};
  for (std::size_t k = 0; k < f.ratios.size(); ++k)
    curve.add(f.ratios[k], double(k) / double(f.ratios.size() - 1));
  plot(folder / "solid_bound.png",
       script_of({curve}, "set logscale x\nset xrange [0.9:*]\nunset key\n" +
                              axes("Every iteration of random touches", "certified over true error",
                                   "share of the iterations")));
}

}  // namespace

Part solid_bound() {
  return make_part("bound", measure, draw);
}

}  // namespace teletact::bench
