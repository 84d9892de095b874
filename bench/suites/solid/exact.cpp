// What the solid must be equal to: the exact layer's forces, what is felt of a lump, plane strain, a sparse
// factor. In double; and in float the tangent of what was learned, beside the converged one.
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>

#include "bench/curves.h"
#include "bench/suites/solid/solid.h"
#include "bench/suites/solid/truth.h"
#include "service/base/choices.h"
#include "service/contact/solid_contact.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

using Eigen::Index;

// Steps of 1 and of 0.5 mm, means over the mesh's phase.
struct Force {
  std::string tip;
  double indentation_m = 0, coarse_n = 0, fine_n = 0, extrapolated_n = 0, exact_n = 0, difference = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Force, tip, indentation_m, coarse_n, fine_n, extrapolated_n, exact_n,
                                   difference)

// Force over a lump, over that on homogeneous tissue.
struct Felt {
  std::string lump;
  double contrast = 0, coarse = 0, fine = 0;  // in blocks of 128 mm
  double wide = 0;                            // the coarse one in a block of 256 mm
  double extrapolated = 0, asked = 0, difference = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Felt, lump, contrast, coarse, fine, wide, extrapolated, asked, difference)

struct Equal {
  std::string what;
  double difference = 0;  // relative
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Equal, what, difference)

// Of what the product answers, over the converged answer.
struct Tangent {
  double ball_depth_m = 0, x_m = 0;  // of the tip, from the ball
  std::size_t corrections = 0;       // for this answer
  double force = 0, tangent = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Tangent, ball_depth_m, x_m, corrections, force, tangent)

struct Figures {
  std::vector<Force> forces{};
  std::vector<Felt> felt{};
  std::vector<Equal> exact{}, sparse{};
  std::vector<Tangent> tangents{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, forces, felt, exact, sparse, tangents)

constexpr double kFeltDepthM = 0.002, kStepM = 0.001;
constexpr std::array kShifts{0.125, 0.375};  // of a step, along x and z

// `width_m` a side; rows grow with depth, each is two of half the step.
service::SolidGrid block(double width_m, double step_m) {
  const auto columns = std::size_t(std::lround(width_m / step_m));
  return {columns, columns, step_m, step_m,
          service::graded_rows(kSolidDepthM, std::size_t(std::lround(0.032 / step_m)),
                               std::pow(1.04, step_m / 0.001))};
}

// Two steps, one half of the other, and an error of their square.
double extrapolated(double coarse, double fine) {
  return (4 * fine - coarse) / 3;
}

// at(x, z): the tip's place from a node, in its four shifts.
template <class At>
double mean_over_shifts(double step_m, At&& at) {
  double sum = 0;
  for (const double x : kShifts)
    for (const double z : kShifts) sum += at(x * step_m, z * step_m);
  return sum / double(kShifts.size() * kShifts.size());
}

// The product's tip, with its skin.
double force_at(service::SolidContact<double>& contact, double x_m, double indentation_m, double z_m) {
  const service::SolidGrid& grid = contact.tissue().grid;
  const service::Vector3 pose{double(grid.nx / 2) * grid.spacing_x_m + x_m, indentation_m,
                              double(grid.nz / 2) * grid.spacing_z_m + z_m};
  const service::ContactAnswer a = contact.touch({}, pose, {.force_error = 1e-5});
  if (!a.solve.converged) throw BenchError(fmt::format("exact: not converged: {}", a.solve.reason));
  return -a.force_n[1];
}

// A rigid tip on the nodes of a surface of that compliance.
double rigid_force(const service::SurfaceCompliance& s0, const service::SolidGrid& grid, double x_m,
                   double indentation_m, double z_m) {
  const SurfaceValues all = paraboloid_push(grid, x_m, z_m, indentation_m);
  return press_rigid(s0.among(all.unknowns), all.values).force_n.sum();
}

void measure_forces(const service::Queue& queue, bool quick, Figures& f) {
  // A paraboloid of 8 mm on a bonded layer of 40 mm, 10 kPa, nu 0.49, no friction: by the Fredholm equation
  // of the exact layer, the same digits with 32 and 48 points.
  for (const auto& [indentation, exact] :
       {std::pair{0.001, 0.0538890}, std::pair{0.002, 0.1581039}, std::pair{0.004, 0.4721386}})
    for (const char* tip : {"rigid", "with its skin"})
      f.forces.push_back({.tip = tip, .indentation_m = indentation, .exact_n = exact});
  for (const auto& [member, step] :
       {std::pair{&Force::coarse_n, kStepM}, std::pair{&Force::fine_n, kStepM / 2}}) {
    // What homogeneous tissue answers is of S0, whose period is 256 mm, and the block's matters to nothing.
    const service::SolidTissue tissue = solid_tissue(block(0.064, step), 0.49, {.contrast = 1});
    const service::SurfaceCompliance s0 = service::wide_surface(tissue.grid, service::layered(tissue), 0.49,
                                                                service::choices::kMinPeriod * kSolidDepthM);
    std::optional<service::SolidContact<double>> contact;
    if (!quick) contact.emplace(queue, tissue);
    for (Force& force : f.forces)
      force.*member = mean_over_shifts(step, [&, step = step](double x, double z) {
        (void)step;
        if (force.tip == "rigid") return rigid_force(s0, tissue.grid, x, force.indentation_m, z);
        return contact ? force_at(*contact, x, force.indentation_m, z) : 0;
      });
  }
  if (quick) std::erase_if(f.forces, [](const Force& force) { return force.tip != "rigid"; });
  for (Force& force : f.forces) {
    force.extrapolated_n = extrapolated(force.coarse_n, force.fine_n);
    force.difference = force.extrapolated_n / force.exact_n - 1;
    std::printf("exact: %-13s %g mm deep in a layer: %.6f, %.6f N, extrapolated %.6f, exact %.6f: %+.3f %%\n",
                force.tip.c_str(), 1e3 * force.indentation_m, force.coarse_n, force.fine_n,
                force.extrapolated_n, force.exact_n, 100 * force.difference);
  }
  std::fflush(stdout);
}

constexpr int kPoints = 4;  // along each side

// ln E by how much of an element is in the lump.
service::SolidTissue with_lump(const service::SolidGrid& grid, bool bar, double contrast, double x_m,
                               double z_m) {
  constexpr SolidLump kBall;
  const double step = grid.spacing_x_m;
  const auto inside = [&](double x, double y, double z) {
    return std::hypot(x - x_m, y - kBall.centre_m[1], bar ? 0 : z - z_m) - kBall.radius_m;
  };
  return service::solid(grid, 0.49, [&](double x, double y, double z) {
    const double away = inside(x, y, z);
    if (std::abs(away) > 3 * step) return kSolidModulusPa * (away < 0 ? contrast : 1);
    const auto row = std::ranges::upper_bound(grid.y_m, y);
    const double height = *row - *(row - 1);
    int points = 0;
    for (int a = 0; a < kPoints; ++a)
      for (int b = 0; b < kPoints; ++b)
        for (int c = 0; c < kPoints; ++c) {
          const auto at = [](int n) { return (n + 0.5) / kPoints - 0.5; };
          points += inside(x + at(a) * step, y + at(b) * height, z + at(c) * step) <= 0;
        }
    return kSolidModulusPa * std::pow(contrast, points / double(kPoints * kPoints * kPoints));
  });
}

// Lump and tip are shifted together.
double felt(const service::Queue& queue, double width_m, double step_m, const Felt& of) {
  const bool bar = of.lump == "bar";
  const service::SolidGrid grid = block(width_m, step_m);
  const double middle = width_m / 2;
  std::optional<service::SolidContact<double>> contact;
  const double over = mean_over_shifts(step_m, [&](double x, double z) {
    if (!bar || z < 0.2 * step_m) {  // a bar along z is the same for all shifts along it
      contact.reset();
      contact.emplace(queue, with_lump(grid, bar, of.contrast, middle + x, middle + z));
    }
    show_progress(fmt::format("a {} of contrast {}, steps of {} mm", of.lump, of.contrast, 1e3 * step_m));
    return force_at(*contact, x, kFeltDepthM, z);
  });
  contact.reset();
  contact.emplace(queue, solid_tissue(block(0.064, step_m), 0.49, {.contrast = 1}));
  return over /
         mean_over_shifts(step_m, [&](double x, double z) { return force_at(*contact, x, kFeltDepthM, z); });
}

void measure_felt(const service::Queue& queue, Figures& f) {
  // Over a ball of 12 mm, 12 mm deep, and a bar of that section along z: another program's, converged.
  for (const auto& [lump, contrast, asked] :
       {std::tuple{"ball", 2.0, 1.071}, {"ball", 10.0, 1.203}, {"bar", 2.0, 1.145}, {"bar", 10.0, 1.438}}) {
    Felt& felt_of = f.felt.emplace_back(Felt{.lump = lump, .contrast = contrast, .asked = asked});
    felt_of.coarse = felt(queue, 0.128, kStepM, felt_of);
    felt_of.fine = felt(queue, 0.128, kStepM / 2, felt_of);
    felt_of.wide = felt(queue, 0.256, kStepM, felt_of);
    felt_of.extrapolated = extrapolated(felt_of.coarse, felt_of.fine) + felt_of.wide - felt_of.coarse;
    felt_of.difference = felt_of.extrapolated / asked - 1;
    std::printf(
        "exact: over a %-4s of contrast %-2g %.4f, %.4f of the layer's force, %.4f in a wide block, "
        "extrapolated %.4f, asked %.3f: %+.2f %%\n",
        lump, contrast, felt_of.coarse, felt_of.fine, felt_of.wide, felt_of.extrapolated, asked,
        100 * felt_of.difference);
    std::fflush(stdout);
  }
}

service::SolidSolution converged(service::SolidSolver<double>& solver, const SolidTouch& touch,
                                 double error) {
  const service::SolidSolution s = touch.solve(solver, {.relative_error = error, .max_iterations = 1000});
  if (s.reason != service::StopReason::kConverged) throw BenchError("exact: a solid did not converge");
  return s;
}

// A bar along z under a load along z is plane strain: each slice answers as one element does.
Equal line_load(const service::Queue& queue, double nu) {
  constexpr std::size_t kSlices = 16, kLoaded = 8;
  Eigen::VectorXd moved[2];
  for (const std::size_t nz : {std::size_t{1}, kSlices}) {
    const service::SolidGrid grid{64, nz, 0.002, 0.002, service::graded_rows(kSolidDepthM, 16, 1.03)};
    const service::SolidTissue bar = service::solid(grid, nu, [](double x, double y, double) {
      return kSolidModulusPa * (std::hypot(x - 0.066, y - 0.012) < 0.006 ? 10 : 1);
    });
    SolidTouch load;
    for (std::size_t k = 0; k < nz; ++k)
      for (std::size_t i = 0; i < kLoaded; ++i)
        for (std::size_t c = 0; c < 2; ++c)
          load.surface.unknowns.push_back(surface_unknown(grid, long(28 + i), long(k), c));
    const auto n = Index(load.surface.unknowns.size());
    load.surface.values =
        Eigen::VectorXd::NullaryExpr(n, [](Index u) { return 1e-2 * (1 + 0.3 * double(u % (2 * kLoaded))); });
    service::SolidSolver<double> solver(queue, bar);
    moved[nz == 1 ? 0 : 1] = converged(solver, load, 1e-11).displacement_m;
  }
  const Eigen::VectorXd all = moved[0].replicate(Index(kSlices), 1);
  return {fmt::format("line load beside one element, nu {}", nu), (moved[1] - all).norm() / all.norm()};
}

// Layers take no iteration but for rounding, and move as the sparse factor says.
Equal layers(const service::Queue& queue, double nu) {
  const service::SolidGrid grid = solid_grid(16, 16, 8, 0.004, 0.004);
  const service::SolidTissue tissue = service::solid(grid, nu, [](double, double y, double) {
    return y < 0.005 ? 3e4 : y < 0.012 ? 1e4 : 1e5;
  });
  const SolidTouch touch{hertz_load(grid)};
  service::SolidSolver<double> solver(queue, tissue);
  const service::SolidSolution s = converged(solver, touch, 1e-10);
  // At nu 0.4999 rounding leaves 2e-8 of the energy norm, which is certified; one iteration takes it away.
  if (s.iterations > (nu > 0.49 ? 1 : 0)) throw BenchError("layered tissue takes iterations");
  Eigen::VectorXd load = Eigen::VectorXd::Zero(Index(grid.unknowns()));
  for (std::size_t n = 0; n < touch.surface.unknowns.size(); ++n)
    load[Index(touch.surface.unknowns[n])] = touch.surface.values[Index(n)];
  const Eigen::VectorXd u = reference::SolidReference(tissue).solve(load);
  return {fmt::format("layers beside a sparse factor, nu {}", nu), (field_of(solver) - u).norm() / u.norm()};
}

// Forces under a rigid tip, asked to 1e-8, beside another program: assembled by Gauss's points, and factored.
Equal beside_the_factor(const service::Queue& queue, double nu, double contrast) {
  const service::SolidGrid grid = solid_grid(16, 16, 8, 0.004, 0.004);
  const service::SolidTissue tissue = solid_tissue(
      grid, nu, {.contrast = contrast, .centre_m = {0.003, 0.010, 0.002}, .radius_m = 0.008}, 0.1);
  const SolidTouch touch{paraboloid_push(grid, 0.001, -0.002, 0.006), true, 0};
  service::SolidSolver<double> solver(queue, tissue);
  const Eigen::VectorXd p = converged(solver, touch, 1e-8).force_n,
                        exact = reference::SolidReference(tissue)
                                    .compliance(touch.surface.unknowns)
                                    .ldlt()
                                    .solve(touch.surface.values);
  return {fmt::format("forces beside a sparse factor, nu {}, contrast {}", nu, contrast),
          (p - exact).norm() / exact.norm()};
}

void measure_tangents(const service::Queue& queue, bool quick, double ball_depth_m, Figures& f) {
  const service::SolidGrid grid = quick ? solid_13k() : solid_70k();
  const service::SolidTissue tissue = solid_tissue(grid, 0.49, {.centre_m = {0, ball_depth_m, 0}});
  service::SolidContact<float> product(queue, tissue);
  service::SolidContact<double> exact(queue, tissue);
  const double middle_x = double(grid.nx) * grid.spacing_x_m / 2,
               middle_z = double(grid.nz) * grid.spacing_z_m / 2;
  for (int n = -12; n <= 12; n += quick ? 6 : 1) {
    Tangent t{ball_depth_m, 0.001 * n};
    const service::Vector3 pose{middle_x + t.x_m, kFeltDepthM, middle_z + 0.002};
    const std::size_t before = product.corrections();
    const service::ContactAnswer a = product.touch({}, pose),
                                 b = exact.touch({}, pose, {.force_error = 1e-7});
    t.corrections = product.corrections() - before;
    using Map3 = Eigen::Map<const Eigen::Vector3d>;
    using Map9 = Eigen::Map<const Eigen::Matrix3d>;
    const Map9 with(a.tangent_n_m.data()), without(b.tangent_n_m.data());
    t.force = (Map3(a.force_n.data()) - Map3(b.force_n.data())).norm() / Map3(b.force_n.data()).norm();
    t.tangent = (with - without).norm() / without.norm();
    f.tangents.push_back(t);
  }
}

double worst_of(const auto& list, auto&& value) {
  double worst = 0;
  for (const auto& item : list) worst = std::max(worst, std::abs(value(item)));
  return worst;
}

Figures measure(bool quick, Promises& promises) {
  const service::Queue queue = service::Device::open()->queue();
  Figures f;
  measure_forces(queue, quick, f);
  if (!quick) measure_felt(queue, f);
  for (const double nu : {0.3, 0.49, 0.4999}) {
    f.exact.push_back(line_load(queue, nu));
    f.exact.push_back(layers(queue, nu));
    for (const double contrast : {10.0, 100.0}) f.sparse.push_back(beside_the_factor(queue, nu, contrast));
  }
  for (const std::vector<Equal>* list : {&f.exact, &f.sparse})
    for (const Equal& e : *list) std::printf("exact: %-54s %.1e\n", e.what.c_str(), e.difference);
  for (const double depth : {0.007, 0.012}) measure_tangents(queue, quick, depth, f);
  for (const char* tip : {"rigid", "with its skin"})
    if (!quick || tip[0] == 'r')
      promises.push_back({fmt::format("layer_force_off_the_exact_one_tip_{}", snake_case(tip)),
                          worst_of(f.forces, [&](const Force& o) { return o.tip == tip ? o.difference : 0; }),
                          0.002});
  if (!quick)
    promises.push_back({"lump_over_layer_off_the_converged_ratio",
                        worst_of(f.felt, [](const Felt& o) { return o.difference; }), 0.005});
  const auto difference = [](const Equal& e) { return e.difference; };
  promises.push_back({"exact_limits_off", worst_of(f.exact, difference), 1e-10});
  promises.push_back({"forces_off_a_sparse_factor", worst_of(f.sparse, difference), 1e-6});
  promises.push_back({"tangent_off_the_converged_one",
                      worst_of(f.tangents, [](const Tangent& t) { return t.tangent; }), 0.02});
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  std::vector<Curve> curves;
  for (const Tangent& t : f.tangents)
    for (const auto& [name, value] : {std::pair{"force", t.force}, {"tangent", t.tangent}}) {
      const std::string title = fmt::format("{}, ball {} mm deep", name, 1e3 * t.ball_depth_m);
      auto curve = std::ranges::find(curves, title, &Curve::title);
      if (curve == curves.end()) curve = curves.insert(curve, Curve{.title = title});
      curve->add(1e3 * t.x_m, 100 * value);
    }
  plot(folder / "solid_tangent.png",
       script_of(curves, "set logscale y\nset key outside bottom center horizontal\n" +
                             axes("The product's answer beside the converged one", "tip from the ball (mm)",
                                  "difference (%)")));
}

}  // namespace

Part solid_exact() {
  return make_part("exact", measure, draw);
}

}  // namespace teletact::bench
