#include "service/contact/solid_answer.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "service/contact/fingertip.h"

namespace teletact::service {

namespace {

// Over the spread of ln(E / E0) in what is felt, and over its size right under the tip.
constexpr double kOfMeshBeyondLayers = 0.045, kOfMeshUnderTip = 0.02, kOfMeshMin = 0.0015;

// Of ln(E / E0), over the elements around a node of the surface.
double spread_under(const SolidTissue& tissue, double layer_pa, std::size_t node) {
  const SolidGrid& grid = tissue.grid;
  const std::size_t x = node % grid.nx, z = node / grid.nx;
  double squares = 0;
  for (const std::size_t i : {x, (x + grid.nx - 1) % grid.nx})
    for (const std::size_t k : {z, (z + grid.nz - 1) % grid.nz})
      squares += std::pow(std::log(tissue.youngs_modulus_pa[i + grid.nx * k] / layer_pa), 2);
  return std::sqrt(squares / 4);
}

}  // namespace

double mesh_beyond_layers(const SolidTissue& tissue, double layer_pa, std::size_t node,
                          double beyond_layers) {
  return kOfMeshBeyondLayers * std::sqrt(beyond_layers) +
         kOfMeshUnderTip * spread_under(tissue, layer_pa, node);
}

void add_solid_budget(const SolidGrid& grid, std::size_t row, const Fingertip& tip, double indentation_m,
                      double of_mesh, ContactAnswer& answer) {
  const bool round = tip.shape == FingertipShape::kRoundedTip || tip.shape == FingertipShape::kSphere;
  if (!round || answer.state != ContactState::kContact) return;
  const double spacing_m = std::max({grid.spacing_x_m, grid.spacing_z_m, grid.y_m[row + 1] - grid.y_m[row]});
  const double mesh = of_mesh * spacing_m * spacing_m / (tip.radius_m * indentation_m);
  answer.budget.add({ErrorTerm::kSolver, TermKind::kBound, answer.solve.relative_error});
  answer.budget.add({ErrorTerm::kMesh, TermKind::kEstimate, mesh + kOfMeshMin});
  answer.budget.add(finite_strain(tip, indentation_m));
}

namespace {

using Eigen::Index;

// Largest principal strain over (1 + nu) p / E, p the mean pressure: 2/3 of twice the largest shear stress,
// 0.31 of the largest pressure, which is 1.5 p (Johnson, Contact Mechanics, 1985, 3.4).
constexpr double kSolidPeakStrain = 0.62;

// What presses: f(node, force) of each.
template <class F>
void each_push(const SolidGrid& grid, const LinearisedContact& contact, const F& f) {
  for (std::size_t n = 0; n < contact.patch.unknowns.size(); ++n) {
    const std::size_t unknown = contact.patch.unknowns[n];
    const double p = contact.force_n[static_cast<Index>(n)];
    if (unknown / grid.columns() == 1 && p > 0) f(unknown % grid.columns(), p);
  }
}

}  // namespace

double modulus_near_pa(const SolidTissue& tissue, std::size_t row, std::size_t node) {
  const SolidGrid& grid = tissue.grid;
  const std::size_t i = node % grid.nx, k = node / grid.nx;
  const std::size_t west = (i + grid.nx - 1) % grid.nx, before = (k + grid.nz - 1) % grid.nz;
  const std::size_t above = row > 0 ? row - 1 : row;
  double sum = 0;
  for (const std::size_t y : {above, row})
    for (const std::size_t x : {west, i})
      for (const std::size_t z : {before, k})
        sum += tissue.youngs_modulus_pa[x + grid.nx * (z + grid.nz * y)];
  return sum / 8;
}

std::vector<NodalPressure> pressure_of(const SolidGrid& grid, std::size_t row,
                                       const LinearisedContact& contact) {
  const double area = grid.spacing_x_m * grid.spacing_z_m;
  std::map<std::size_t, Vector3> traction;
  for (std::size_t n = 0; n < contact.patch.unknowns.size(); ++n) {
    const std::size_t unknown = contact.patch.unknowns[n], component = unknown / grid.columns();
    if (component != 1)
      traction[unknown % grid.columns()][component] = contact.force_n[static_cast<Index>(n)] / area;
  }
  std::vector<NodalPressure> out;
  each_push(grid, contact, [&](std::size_t node, double p) {
    const auto sideways = traction.find(node);
    const std::size_t i = node % grid.nx, k = node / grid.nx;
    out.push_back({{static_cast<double>(i) * grid.spacing_x_m, grid.y_m[row],
                    static_cast<double>(k) * grid.spacing_z_m},
                   p / area,
                   sideways == traction.end() ? Vector3{} : sideways->second,
                   {grid.spacing_x_m, grid.spacing_z_m}});
  });
  return out;
}

double force_of(const SolidGrid& grid, const LinearisedContact& contact) {
  double force = 0;
  each_push(grid, contact, [&](std::size_t, double p) { force += p; });
  return force;
}

double contact_strain(double poisson_ratio, double pressure_pa, double youngs_modulus_pa) {
  return kSolidPeakStrain * (1 + poisson_ratio) * pressure_pa / youngs_modulus_pa;
}

void set_strain(const SolidTissue& tissue, std::size_t row, const LinearisedContact& contact, double depth_m,
                ContactAnswer& answer) {
  const SolidGrid& grid = tissue.grid;
  const double area = grid.spacing_x_m * grid.spacing_z_m;
  double force = 0, squares = 0, stiffness = 0;
  each_push(grid, contact, [&](std::size_t node, double p) {
    force += p;
    squares += p * p;
    stiffness += p * modulus_near_pa(tissue, row, node);
  });
  // Mean pressure, weighted by itself, over the modulus, weighted by what it bears.
  const double local = contact_strain(tissue.poisson_ratio, squares / force / area, stiffness / force);
  set_strain(local, depth_m / (grid.y_m.back() - grid.y_m[row]), answer);
}

void set_strain(double below_contact, double of_all, ContactAnswer& answer) {
  answer.largest_strain = std::max(below_contact, of_all);
  answer.strain_beyond_linear = answer.largest_strain > kLargestLinearStrain;
}

ForceError finite_strain(const Fingertip& tip, double indentation_m) {
  constexpr double kOfRoot = 0.06, kOfStrain = 0.025;
  const double x = indentation_m / tip.radius_m;
  return {ErrorTerm::kFiniteStrain, TermKind::kEstimate,
          (kOfRoot * std::sqrt(x) + kOfStrain * x) / ForceBudget::kOf95};
}

double stiffening(const Fingertip& tip, double indentation_m) {
  constexpr double kPower = 1.8;
  return std::pow(indentation_m / tip.radius_m, kPower);
}

double lost_by_sliding(const Fingertip& tip, double indentation_m, double depth_m) {
  constexpr double kNarrow = 0.4, kWide = 0.3;
  const double narrow = std::sqrt(tip.radius_m * indentation_m) / depth_m;
  return std::min(1.0, narrow * (kNarrow + kWide * narrow));
}

void set_forces(const SolidEnergy& energy, ContactAnswer& answer) {
  answer.state = ContactState::kContact;
  answer.energy_j = energy.value;
  bool finite = std::isfinite(energy.value);
  for (Index c = 0; c < 3; ++c) {
    answer.force_n[static_cast<std::size_t>(c)] = -energy.gradient[c];
    finite = finite && std::isfinite(energy.gradient[c]);
    for (Index d = 0; d < 3; ++d) {
      answer.tangent_n_m[static_cast<std::size_t>(3 * c + d)] = -energy.hessian(c, d);
      finite = finite && std::isfinite(energy.hessian(c, d));
    }
  }
  if (!finite)
    throw std::domain_error("contact: the force or its stiffness is not finite; the model is unusable");
}

std::size_t nearest_node(const SolidGrid& grid, const Vector3& pose) {
  const auto column = [](double at_m, double spacing_m, std::size_t period) {
    const auto n = static_cast<long>(period);
    return static_cast<std::size_t>((std::lround(at_m / spacing_m) % n + n) % n);
  };
  return column(pose[0], grid.spacing_x_m, grid.nx) + grid.nx * column(pose[2], grid.spacing_z_m, grid.nz);
}

void touch_layers(const SolidGrid& grid, const LayeredTouch::At& layers, const Vector3& pose,
                  ContactAnswer& answer) {
  answer.state = ContactState::kContact;
  answer.energy_j = layers.energy_j;
  answer.force_n = {0, -layers.force_n, 0};
  answer.tangent_n_m[4] = -layers.stiffness_n_m;
  const std::size_t node = nearest_node(grid, pose), i = node % grid.nx, k = node / grid.nx;
  const double x_m = grid.spacing_x_m, z_m = grid.spacing_z_m;
  answer.pressure = {{{static_cast<double>(i) * x_m, grid.y_m.front(), static_cast<double>(k) * z_m},
                      layers.force_n / (x_m * z_m),
                      {},
                      {x_m, z_m}}};
}

}  // namespace teletact::service
