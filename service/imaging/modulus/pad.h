// A stand-off pad between the probe's face and the tissue (T3.6): a layer of known modulus, beside whose
// strain the tissue's tells its modulus without a force.
#pragma once

#include <Eigen/Core>

#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/modulus/weighed_tissues.h"

namespace teletact::service {

// About a pad's end the strain's kernel sees both sides.
inline constexpr double kPadEdgeM = 1.5e-3;

// ln E of the face's pad over that of the tissue, in which it is 0; a cell of both has the mean of the bounds
// of Voigt and Reuss.
Eigen::VectorXd pad_cells(const ProbeFace&, const CellGrid&);

// Of its thickness, within the image.
KnownLength pad_known(const StandoffPad&, double image_m);

// `observed` within a pad, its edge left out. Throws std::invalid_argument where nothing is.
Eigen::VectorXd in_pad(const Eigen::VectorXd& observed, const CellGrid&, double pad_m);

// ln of the pad's modulus over the tissue's, about: by how much more the strain falls from the tissue to the
// pad than it does in homogeneous tissue. `measured` and `homogeneous`: ln(strain). Throws
// std::invalid_argument where one of them shows none, and beyond kMostPadLog.
double first_pad_log(const Eigen::VectorXd& homogeneous, const Eigen::VectorXd& measured,
                     const Eigen::VectorXd& observed, const CellGrid&, double pad_m);

// What lies above the first row that is all tissue becomes as that.
void end_at_pad(Eigen::VectorXd& of_cells, const CellGrid&, double pad_m);

}  // namespace teletact::service
