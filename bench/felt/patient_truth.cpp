#include "bench/felt/patient_truth.h"

#include <fmt/format.h>

#include <memory>
#include <vector>

#include "bench/suite.h"
#include "client/acquire/solid_source.h"
#include "client/patient/true_modulus.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::bench {
namespace {

using client::SolidPatient;

constexpr double kNodeM = 0.001;

service::SolidTissue layered(const TrueSolid& solid, const service::SolidGrid& grid) {
  return service::solid(grid, solid.poisson_ratio,
                        [&](double, double y, double) { return solid.layered_pa(y); });
}

// Over an element of 1 mm.
double mean_modulus(const client::Tissue& tissue, double x_m, double y_m, double z_m) {
  constexpr double kAsideM = kNodeM / 4;
  double sum = 0;
  for (const double dx : {-kAsideM, kAsideM})
    for (const double dy : {-kAsideM, kAsideM})
      for (const double dz : {-kAsideM, kAsideM}) sum += tissue.true_modulus(x_m + dx, y_m + dy, z_m + dz);
  return sum / 8;
}

// Of the tissue, of its bed, of rollers.
std::vector<double> rows(const TrueSolid& solid, std::size_t layers) {
  constexpr int kOfBed = 5;
  std::vector<double> y_m = service::graded_rows(solid.depth_m, layers, 1.03);
  for (int n = 0; n < kOfBed && solid.bed_m > 0; ++n) y_m.push_back(y_m.back() + solid.bed_m / kOfBed);
  if (solid.slides) y_m.push_back(2 * y_m.back() - y_m[y_m.size() - 2]);
  return y_m;
}

}  // namespace

TrueSolid true_solid(const SolidPatient& patient) {
  return {SolidPatient::kWidthM / 2, SolidPatient::kDepthM, SolidPatient::kPoissonRatio,
          [&patient](double x, double y, double z) { return patient.modulus_pa(x, y, z); },
          [&patient](double y) { return patient.layered_pa(y); }};
}

TrueSolid true_solid(const client::Tissue& tissue) {
  if (!tissue.solid) throw BenchError("--tissue: it has no [solid]");
  const client::Solid& held = *tissue.solid;
  const double left_m = client::slice_window_x_m(tissue);
  const auto texture = std::make_shared<client::TrueModulus>(tissue);
  const auto even = std::make_shared<client::Tissue>(tissue);
  even->inclusions.clear();
  // Below the tissue its bed; rollers are as the tissue above them.
  const bool bed = held.support == client::Support::kBed;
  const auto in_bed = [bed, &tissue](double y) { return bed && y > tissue.depth_m; };
  TrueSolid out{tissue.probe.width_m / 2, tissue.depth_m, tissue.poisson_ratio,
                [&tissue, &held, in_bed, texture, left_m](double x, double y, double z) {
                  return in_bed(y)
                             ? held.bed_modulus_pa
                             : mean_modulus(tissue, x + left_m, y, z) * texture->texture(x + left_m, y, z);
                },
                [&held, in_bed, even](double y) {
                  return in_bed(y) ? held.bed_modulus_pa : even->true_modulus(even->width_m / 2, y);
                }};
  if (bed) out.bed_m = held.bed_depth_m;
  out.slides = held.support == client::Support::kSliding;
  out.sides = {-left_m, tissue.width_m - left_m, -held.elevational_width_m / 2, held.elevational_width_m / 2};
  return out;
}

// The patient amid 128 x 128 mm.
auto PatientTruth::nodes(const TrueSolid& solid) -> Place {
  return {{128, 128, kNodeM, kNodeM, rows(solid, 48), solid.slides}, solid.middle_x_m - 0.0643, -0.0643};
}
// Of half that spacing, for layered tissue alone: so small a block is wide enough for it.
auto PatientTruth::finest_nodes(const TrueSolid& solid, const service::Vector3& pose) -> Place {
  return {{64, 64, 0.0005, 0.0005, rows(solid, 72), solid.slides}, pose[0] - 0.0161, pose[2] - 0.0161};
}

PatientTruth::PatientTruth(const service::Queue& queue, const TrueSolid& solid, const service::Fingertip& tip)
    : queue_(queue),
      tip_(tip),
      solid_(solid),
      nodes_(nodes(solid)),
      tissue_(service::solid(
          nodes_.grid, solid.poisson_ratio,
          [&](double x, double y, double z) { return solid.modulus_pa(x + nodes_.x_m, y, z + nodes_.z_m); })),
      base_(queue, tissue_),
      layers_(queue, layered(solid, nodes_.grid)),
      finest_layers_(queue, layered(solid, finest_nodes(solid, {}).grid)) {}

double PatientTruth::layered_n(service::SolidContact<double>& contact,
                               const service::Vector3& in_block) const {
  const auto answer = contact.touch(tip_, in_block);
  if (!answer.solve.converged) throw BenchError("layered tissue was not solved exactly");
  return -answer.force_n[1];
}

auto PatientTruth::at(const service::Vector3& position_m) -> Force {
  service::SolidContact<double> contact(queue_, base_, tissue_);  // it has learned nothing
  const auto truth = contact.touch(tip_, nodes_.in_block(position_m), {.force_error = kForceError});
  if (!truth.solve.converged) throw BenchError(fmt::format("no true force: {}", truth.solve.reason));
  const double layered = layered_n(layers_, nodes_.in_block(position_m));
  const double finest = layered_n(finest_layers_, finest_nodes(solid_, position_m).in_block(position_m));
  Force out;
  out.nodes = 3 * layered / (4 * finest - layered);  // Richardson
  out.force_n = Eigen::Map<const Eigen::Vector3d>(truth.force_n.data()) / out.nodes;
  return out;
}

}  // namespace teletact::bench
