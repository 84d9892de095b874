#include "service/imaging/modulus/pad.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

#include "service/imaging/modulus/skin.h"

namespace teletact::service {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

VectorXd within(const VectorXd& observed, const CellGrid& cells, double above_m, double below_m) {
  VectorXd out = observed;
  for (std::size_t c = 0; c < cells.size(); ++c)
    if (!(cells.y_m(c) > above_m && cells.y_m(c) < below_m)) out[static_cast<Index>(c)] = 0;
  return out;
}

}  // namespace

VectorXd pad_cells(const ProbeFace& face, const CellGrid& cells) {
  VectorXd out = VectorXd::Zero(static_cast<Index>(cells.size()));
  if (!(face.pad_m > 0)) return out;
  const Surface pad{Surface::Kind::kCapsule, face.pad_m, std::exp(face.pad_log)};
  for (std::size_t c = 0; c < cells.size(); ++c)
    out[static_cast<Index>(c)] = layer_log(pad, cells.row(c), cells.row_m)[0];
  return out;
}

KnownLength pad_known(const StandoffPad& pad) {
  const double log = std::log(pad.thickness_m), reach = 2 * kLinear;
  return {true, log, pad.thickness_std_m / pad.thickness_m, log - reach, log + reach};
}

VectorXd in_pad(const VectorXd& observed, const CellGrid& cells, double pad_m) {
  return within(observed, cells, 0, pad_m - kPadEdgeM);
}

double first_pad_log(const VectorXd& homogeneous, const VectorXd& measured, const VectorXd& observed,
                     const CellGrid& cells, double pad_m) {
  const VectorXd pad = in_pad(observed, cells, pad_m),
                 below = within(observed, cells, pad_m + kPadEdgeM, HUGE_VAL), off = homogeneous - measured;
  for (const auto& [where, said] : {std::pair(&pad, "in"), std::pair(&below, "below")})
    if (!(where->sum() > 0))
      throw std::invalid_argument(fmt::format(
          "pad_thickness_m: no strain was tracked {} a pad of {:.1f} mm; use one that shows speckle "
          "and check its thickness, or state the probe's force instead",
          said, 1e3 * pad_m));
  return pad.dot(off) / pad.sum() - below.dot(off) / below.sum();
}

}  // namespace teletact::service
