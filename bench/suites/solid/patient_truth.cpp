#include "bench/suites/solid/patient_truth.h"

#include <fmt/format.h>

#include "bench/suite.h"
#include "tests/solid/solids.h"

namespace teletact::bench {
namespace {

using client::SolidPatient;

service::SolidTissue layered(const SolidPatient& patient, const service::SolidGrid& grid) {
  return service::solid(grid, SolidPatient::kPoissonRatio,
                        [&](double, double y, double) { return patient.layered_pa(y); });
}

}  // namespace

// The patient amid 128 x 128 mm.
auto PatientTruth::nodes() -> Place {
  return {{128, 128, 0.001, 0.001, service::graded_rows(SolidPatient::kDepthM, 48, 1.03)}, -0.0083, -0.0643};
}
// Of half that spacing, for layered tissue alone: so small a block is wide enough for it.
auto PatientTruth::finest_nodes(const service::Vector3& pose) -> Place {
  return {{64, 64, 0.0005, 0.0005, service::graded_rows(SolidPatient::kDepthM, 72, 1.03)},
          pose[0] - 0.0161,
          pose[2] - 0.0161};
}

PatientTruth::PatientTruth(const service::Queue& queue, const SolidPatient& patient,
                           const service::Fingertip& tip)
    : queue_(queue),
      tip_(tip),
      nodes_(nodes()),
      tissue_(service::solid(nodes_.grid, SolidPatient::kPoissonRatio,
                             [&](double x, double y, double z) {
                               return patient.modulus_pa(x + nodes_.x_m, y, z + nodes_.z_m);
                             })),
      base_(queue, tissue_),
      layers_(queue, layered(patient, nodes_.grid)),
      finest_layers_(queue, layered(patient, finest_nodes({}).grid)) {}

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
  const double finest = layered_n(finest_layers_, finest_nodes(position_m).in_block(position_m));
  Force out;
  out.nodes = 3 * layered / (4 * finest - layered);  // Richardson
  out.force_n = Eigen::Map<const Eigen::Vector3d>(truth.force_n.data()) / out.nodes;
  return out;
}

}  // namespace teletact::bench
