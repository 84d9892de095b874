// One element along z is plane strain: compliance of the surface beside that of the plane model, which
// eliminates row by row. The block is so long that neither its period nor the plane's ends are felt.
#include <cmath>
#include <cstdio>
#include <optional>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/solid_blocks.h"
#include "bench/suites/solid/solid.h"
#include "service/tissue/solid/solid_solver.h"
#include "service/tissue/tissue_model.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

struct Beside {
  double poisson_ratio = 0, contrast = 0, certified = 0;
  double difference = 0;  // of an entry C_ij over sqrt(C_ii C_jj), at most
  std::size_t iterations = 0;
  double solid_s = 0, plane_s = 0;  // from the modulus to one load's answer; to the condensed surface
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Beside, poisson_ratio, contrast, certified, difference, iterations,
                                   solid_s, plane_s)

struct Figures {
  std::vector<Beside> beside{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, beside)

constexpr std::size_t kColumns = 512;
constexpr double kSpacingM = 0.002;

void compare(const service::Queue& queue, double nu, double contrast, Figures& f) {
  const service::SolidGrid grid{kColumns, 1, kSpacingM, 0.002, service::graded_rows(0.020, 12, 1.1)};
  const service::SolidTissue solid =
      solid_tissue(grid, nu, {.contrast = contrast, .centre_m = {0.002, 0.008, 0}});
  const service::TissueGrid plane_grid{service::uniform_coordinates(0, kColumns * kSpacingM, kColumns),
                                       grid.y_m};
  const double middle_m = kColumns * kSpacingM / 2;
  std::optional<service::TissueModel> plane;
  const double plane_s = seconds_of([&] {
    plane.emplace(
        plane_grid, service::Material{solid.youngs_modulus_pa, nu}, service::Supports{},
        service::TissueModelOptions{.touch_begin_m = middle_m - 0.02, .touch_end_m = middle_m + 0.02});
    plane->compliance(0);
  });
  std::vector<std::size_t> nodes;
  for (std::size_t i = kColumns / 2 - 8; i <= kColumns / 2 + 8; i += 2) nodes.push_back(i);
  // m/N: the plane's is for a force for each metre of thickness.
  const Eigen::MatrixXd c = plane->compliance(0)->axial_among(nodes, nullptr) / grid.spacing_z_m;
  { service::SolidSolver<double> compiles(queue, solid); }
  std::optional<service::SolidSolver<double>> solver;
  const double setup_s = seconds_of([&] { solver.emplace(queue, solid); });
  std::vector<std::size_t> unknowns;
  for (const std::size_t i : nodes) unknowns.push_back(surface_unknown(grid, long(i), 0, 1));
  for (const double certified : {1e-2, 1e-4, 1e-6, 1e-10}) {
    Beside b{nu, contrast, certified};
    std::vector<double> seconds;
    for (Eigen::Index j = 0; j < c.cols(); ++j) {
      service::SolidSolution s;
      seconds.push_back(seconds_of([&] {
        s = solver->load(unknowns, Eigen::VectorXd::Unit(c.cols(), j),
                         {.relative_error = certified, .max_iterations = 1000});
      }));
      if (s.reason != service::StopReason::kConverged)
        throw BenchError("the solid of one element did not converge");
      b.iterations = std::max(b.iterations, s.iterations);
      for (Eigen::Index i = 0; i < c.rows(); ++i)
        b.difference =
            std::max(b.difference, std::abs(s.displacement_m[i] - c(i, j)) / std::sqrt(c(i, i) * c(j, j)));
    }
    b.plane_s = plane_s, b.solid_s = setup_s + median_of(seconds);
    std::printf(
        "plane: nu %-6g contrast %-4g certified to %.0e in %2zu iterations, %.1f ms: off the plane model, "
        "%.1f ms, by %.1e\n",
        nu, contrast, certified, b.iterations, 1e3 * b.solid_s, 1e3 * b.plane_s, b.difference);
    f.beside.push_back(b);
  }
}

Figures measure(bool quick, Promises& promises) {
  const service::Queue queue = service::Device::open()->queue();
  Figures f;
  double worst = 0;
  for (const double nu : {0.3, 0.49, 0.4999})
    for (const double contrast : {10.0, 100.0})
      if (!quick || (nu == 0.49 && contrast == 10)) {
        compare(queue, nu, contrast, f);
        worst = std::max(worst, f.beside.back().difference);
      }
  promises.push_back({"one_element_thick_off_the_plane_model", worst, 1e-10});
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  std::vector<Curve> curves;
  for (const Beside& b : f.beside) {
    const std::string title =
        "nu " + nlohmann::json(b.poisson_ratio).dump() + ", contrast " + nlohmann::json(b.contrast).dump();
    if (curves.empty() || curves.back().title != title) curves.push_back({.title = title});
    curves.back().add(b.certified, b.difference);
  }
  plot(folder / "solid_plane.png",
       script_of(curves,
                 "set logscale xy\nset format xy '10^{%L}'\nset key top left\n" +
                     axes("One element along z, beside the plane model", "certified error of the energy norm",
                          "largest difference of a compliance")));
  Curve solid{.title = "solid of one element: set-up, one load", .ours = true},
      plane{.title = "plane model: the surface condensed"};
  for (const Beside& b : f.beside)
    if (b.poisson_ratio == 0.49 && b.contrast == 10)
      solid.add(b.certified, 1e3 * b.solid_s), plane.add(b.certified, 1e3 * b.plane_s);
  plot(folder / "solid_plane_time.png",
       script_of({solid, plane}, "set logscale xy\nset format x '10^{%L}'\nset key top right\n" +
                                     axes("512 columns, nu 0.49, contrast 10",
                                          "certified error of the energy norm", "time (ms)")));
}

}  // namespace

Part solid_plane() {
  return make_part("plane", measure, draw);
}

}  // namespace teletact::bench
