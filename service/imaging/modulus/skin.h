// The tissue's topmost millimetres, in which no strain is measured (T3.6): layers along the face, told by
// what they change of the strain below, most of all at the face's ends.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::service {

inline constexpr std::size_t kSkinLayers = 3;  // rows of fine cells, about 1 mm each
// What is not known of ln E in them over that below: a change of all alike, then of each by itself.
inline constexpr std::size_t kSkinChanges = kSkinLayers + 1;
// Standard deviation of what changes of it along the face, over 20 mm.
inline constexpr double kSkinVariesLog = 0.15;

struct SkinPrior {
  // Skin of which nothing is said: each layer within a factor of two, half of which (as variance) is alike.
  std::array<double, kSkinChanges> mean{}, deviation{0.49, 0.49, 0.49, 0.49};
};
// Of what is stated, in layers of row_m. A capsule that fills a layer in part counts as the mean (Hill 1952,
// doi 10.1088/0370-1298/65/5/307) of the bounds by Voigt and Reuss, with half of their distance as a
// deviation.
SkinPrior skin_known(const Surface&, double row_m);
// ln E of a layer, part of which is a capsule, over that of what is below: mean of the two bounds, and half
// of their distance.
std::array<double, 2> layer_log(const Surface& capsule, std::size_t layer, double row_m);

// What a change changes under a face on homogeneous tissue: ln(strain) as measured, and ln(force).
struct SkinAnswer {
  std::array<Eigen::VectorXd, kSkinChanges> log_strain;
  std::array<double, kSkinChanges> log_force;
};

// In the cells `at`, of homogeneous tissue that answers by `log_strain` and `log_force` in its own, by
// kSkinSolves pushes. Throws as push().
SkinAnswer skin_answer(ProbedTissue&, const Eigen::VectorXd& log_strain, double log_force,
                       const StrainOptions&, const CellGrid& at);
inline constexpr int kSkinSolves = static_cast<int>(kSkinLayers);

// 1 in the layers that the change is of, else 0.
Eigen::VectorXd skin_cells(const CellGrid&, std::size_t change);

}  // namespace teletact::service
