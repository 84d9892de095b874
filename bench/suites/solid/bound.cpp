// What is certified (T8.3) over the true error, at every iteration of touches of random lumps and textures:
// of the energy, and of the force; in float, the error below which it does not hold.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "bench/curves.h"
#include "bench/suites/solid/solid.h"
#include "bench/suites/solid/truth.h"

namespace teletact::bench {
namespace {

struct Float {
  double poisson_ratio = 0, contrast = 0;
  double floor = 0;        // largest true error that exceeds what is certified for it
  double min_error = 1;  // that was reached
  double said_from = 0;    // the true error when the solver first says that its bound is broken; 0: never
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Float, poisson_ratio, contrast, floor, min_error, said_from)

// What is certified over the true error, of every iteration.
struct Ratios {
  std::size_t iterations = 0, broken = 0;
  double least = HUGE_VAL, median = 0, p95 = 0, most = 0;
  std::vector<double> by_rank{};  // 200 of them
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Ratios, iterations, broken, least, median, p95, most, by_rank)

struct Figures {
  std::size_t tissues = 0, touches = 0, contacts = 0;  // contacts: touches by a tip, whose force is bounded
  Ratios energy{}, force{};
  std::vector<Float> in_float{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, tissues, touches, contacts, energy, force, in_float)

// 6.7 k nodes in steps of 4 mm; 2 x 8 mm; and, with rows from 1 mm on, 13 k.
constexpr std::size_t kShapes = 3;
service::SolidGrid grid(std::size_t shape = 0) {
  return shape == 0   ? solid_grid(32, 16, 13, 0.004, 0.004)
         : shape == 1 ? solid_grid(64, 8, 13, 0.002, 0.008)
                      : solid_grid(32, 16, 26, 0.004, 0.004);
}

// Soft and stiff lumps anywhere, with and without texture; a tip presses with and without a skin, or a load.
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
    const service::SolidGrid on = grid(engine() % kShapes);
    return solid_tissue(on, nu, lump, texture, engine());
  }
  SolidTouch touch(service::SolidSolver<double>& solver, const service::SolidGrid& on) {
    const bool pressed = engine() % 4 != 0;
    const double skin_m_n = engine() % 2 ? std::exp(uniform(std::log(1e-4), std::log(1e-1))) : 0;
    const double x = uniform(-0.04, 0.04), z = uniform(-0.02, 0.02), indentation = uniform(0.002, 0.010);
    if (pressed) return settled_touch(solver, on, x, z, indentation, skin_m_n);
    return {paraboloid_push(on, x, z, indentation)};
  }
};

// Iterates 0, 1 ... of a touch, and what is certified: |e| of the energy norm, and whether it is.
struct Iterates {
  std::vector<Eigen::VectorXd> fields{};
  std::vector<double> error{};
  std::vector<bool> certified{};
};
template <class T>
Iterates iterates(service::SolidSolver<T>& solver, const SolidTouch& touch, double to_error,
                  std::size_t most) {
  Iterates out;
  const auto watch = [&](const service::SolidSolution& s) {
    out.fields.push_back(field_of(solver));
    out.error.push_back(std::sqrt(2 * s.energy_error_j));
    out.certified.push_back(s.certified);
    return s.bounded_error() > to_error;
  };
  touch.solve(solver, {.relative_error = 0, .max_iterations = most, .watch = watch});
  return out;
}

Ratios ratios_of(std::vector<double> ratios, std::size_t broken) {
  std::sort(ratios.begin(), ratios.end());
  const auto at = [&](double share) { return ratios.at(std::size_t(share * double(ratios.size() - 1))); };
  Ratios r{ratios.size(), broken, at(0), at(0.5), at(0.95), at(1)};
  for (int k = 0; k < 200; ++k) r.by_rank.push_back(at(k / 199.0));
  return r;
}
void print(const char* what, const Ratios& r) {
  std::printf(
      "bound of the %s: %zu iterations, broken in %zu; over the true error: least %.6f, median %.3f, "
      "95 %% %.2f, most %.3g\n",
      what, r.iterations, r.broken, r.least, r.median, r.p95, r.most);
}

void measure_double(const service::Queue& queue, bool quick, Figures& f) {
  constexpr double kMin =
      1e-6;  // of the energy norm; of the force, its square's share that rounding leaves
  constexpr double kMinForce = 1e-8, kForceRounding = 1e-10;
  Draw draw{std::mt19937_64(20261121)};
  const std::size_t tissues = quick ? 8 : 100, touches = quick ? 4 : 10;
  std::vector<double> energies, forces;
  std::size_t broken = 0, broken_force = 0;
  for (std::size_t t = 0; t < tissues; ++t) {
    const service::SolidTissue tissue = draw.tissue();
    const Eigen::SparseMatrix<double> k = reference::assemble(tissue);
    service::SolidSolver<double> solver(queue, tissue);
    for (std::size_t n = 0; n < touches; ++n, ++f.touches) {
      const SolidTouch touch = draw.touch(solver, tissue.grid);
      const SolidTruth truth(k, solver, touch);
      const double size = std::sqrt(truth.energy());
      const Iterates u = iterates(solver, touch, kMin / 3, 1000);
      const Fields fields = fields_of(u.fields);
      const Eigen::VectorXd squared = truth.squared_errors(fields);
      for (std::size_t i = 0; i < u.error.size(); ++i) {
        const double error = std::sqrt(squared[Eigen::Index(i)]), certified = u.error[i] / size;
        if (error < kMin) break;
        // The truth itself is off by its own certified error.
        broken += certified + 2 * SolidTruth::kError < error;
        energies.push_back(certified / error);
      }
      if (!touch.pushed) continue;
      ++f.contacts;
      const SolidTouch unit = touch.unit();
      const SolidTruth unit_truth(k, solver, unit);
      const Iterates z = iterates(solver, unit, kMin / 3, 1000);
      const Eigen::Index both = Eigen::Index(std::min(u.error.size(), z.error.size()));
      const double force =
          truth.works(fields_of({truth.displacement()}), fields_of({unit_truth.displacement()}))[0];
      if (std::abs(force - truth.force_n().sum()) > 1e-7 * force)
        throw BenchError("the force is not the work in the unit push");
      const Eigen::VectorXd felt = truth.works(fields.leftCols(both), fields_of(z.fields).leftCols(both));
      for (Eigen::Index i = 0; i < both; ++i) {
        const double certified = u.error[std::size_t(i)] * z.error[std::size_t(i)] / force,
                     error = std::abs(felt[i] / force - 1);
        if (certified < kMinForce) break;
        broken_force += certified + kForceRounding < error;
        forces.push_back(certified / std::max(error, kForceRounding));
      }
    }
    show_progress("tissue " + std::to_string(t));
  }
  f.tissues = tissues;
  print("energy", f.energy = ratios_of(std::move(energies), broken));
  print("force", f.force = ratios_of(std::move(forces), broken_force));
  std::printf("bound: %zu touches, of them %zu by a tip\n", f.touches, f.contacts);
}

Float measure_float(const service::Queue& queue, double nu, double contrast) {
  const service::SolidTissue tissue = solid_tissue(grid(), nu, {.contrast = contrast});
  const Eigen::SparseMatrix<double> k = reference::assemble(tissue);
  service::SolidSolver<double> exact(queue, tissue);
  service::SolidSolver<float> solver(queue, tissue);
  Float out{nu, contrast};
  for (const double x : {0.0, 0.007}) {
    const SolidTouch touch = settled_touch(exact, tissue.grid, x, 0.003, 0.008, 0);
    const SolidTruth truth(k, exact, touch);
    const Iterates u = iterates(solver, touch, 0, 150);
    const Eigen::VectorXd squared = truth.squared_errors(fields_of(u.fields));
    for (std::size_t i = 0; i < u.error.size(); ++i) {
      const double error = std::sqrt(squared[Eigen::Index(i)]),
                   certified = u.error[i] / std::sqrt(truth.energy());
      out.min_error = std::min(out.min_error, error);
      if (certified < error) out.floor = std::max(out.floor, error);
      if (!u.certified[i] && out.said_from == 0) out.said_from = error;
    }
  }
  std::printf("bound in float: nu %-6g contrast %-4g broken below %.1e, said from %.1e on, reached %.1e\n",
              nu, contrast, out.floor, out.said_from, out.min_error);
  return out;
}

Figures measure(bool quick, Promises& promises) {
  const service::Queue queue = service::Device::open()->queue();
  Figures f;
  measure_double(queue, quick, f);
  for (const double nu : {0.3, 0.49, 0.4999})
    for (const double contrast : {10.0, 1000.0})
      if (!quick || contrast == 10) f.in_float.push_back(measure_float(queue, nu, contrast));
  promises.push_back({"iterations_where_the_bound_is_broken", double(f.energy.broken), 0});
  promises.push_back({"certified_over_true_error_median", f.energy.median, 2});
  promises.push_back({"iterations_where_the_bound_of_the_force_is_broken", double(f.force.broken), 0});
  if (!quick) promises.push_back({"touches_whose_bound_was_looked_at", double(f.touches), 1000, "1", false});
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  std::vector<Curve> curves{{.title = "energy norm", .ours = true, .style = "lines lw 3"},
                            {.title = "force", .style = "lines lw 3"}};
  for (const auto& [curve, ratios] : {std::pair{&curves[0], &f.energy}, {&curves[1], &f.force}})
    for (std::size_t k = 0; k < ratios->by_rank.size(); ++k)
      curve->add(ratios->by_rank[k], double(k) / double(ratios->by_rank.size() - 1));
  plot(folder / "solid_bound.png",
       script_of(curves, "set logscale x\nset xrange [0.9:1e5]\nset key bottom right\n" +
                             axes("Every iteration of random touches", "certified over true error",
                                  "share of the iterations")));
}

}  // namespace

Part solid_bound() {
  return make_part("bound", measure, draw);
}

}  // namespace teletact::bench
