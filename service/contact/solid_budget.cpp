#include "service/contact/solid_budget.h"

#include <algorithm>
#include <cmath>

#include "service/contact/fingertip.h"
#include "service/contact/solid_answer.h"

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

}  // namespace teletact::service
