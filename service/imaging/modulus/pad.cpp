#include "service/imaging/modulus/pad.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "service/imaging/modulus/skin.h"

namespace teletact::service {

using Eigen::Index;
using Eigen::VectorXd;

namespace {

constexpr double kMostOfImage = 2.0 / 3;  // that a thickness may come to

std::invalid_argument untold(const char* where, double pad_m) {
  return std::invalid_argument(fmt::format(
      "pad_thickness_m: no strain was tracked {} a pad of {:.1f} mm, from 3 mm below the face on and "
      "{:.1f} mm from its end; use one that shows speckle, check its thickness, or state the probe's "
      "force instead",
      where, 1e3 * pad_m, 1e3 * kPadEdgeM));
}

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

KnownLength pad_known(const StandoffPad& pad, double image_m) {
  const double log = std::log(pad.thickness_m), reach = 2 * kLinear;
  return {true, log, pad.thickness_std_m / pad.thickness_m, log - reach,
          std::max(log, std::min(log + reach, std::log(kMostOfImage * image_m)))};
}

VectorXd in_pad(const VectorXd& observed, const CellGrid& cells, double pad_m) {
  const VectorXd out = within(observed, cells, 0, pad_m - kPadEdgeM);
  if (out.sum() > 0) return out;
  throw untold("in", pad_m);
}

double first_pad_log(const VectorXd& homogeneous, const VectorXd& measured, const VectorXd& observed,
                     const CellGrid& cells, double pad_m) {
  const VectorXd pad = in_pad(observed, cells, pad_m),
                 below = within(observed, cells, pad_m + kPadEdgeM, HUGE_VAL), off = homogeneous - measured;
  if (!(below.sum() > 0)) throw untold("below", pad_m);
  const double log = pad.dot(off) / pad.sum() - below.dot(off) / below.sum();
  if (std::abs(log) > kMostPadLog)
    throw std::invalid_argument(
        fmt::format("pad_thickness_m: by its strain the pad has {:.3g} times the tissue's modulus, more than "
                    "{:.3g} times off; check its thickness, or use another pad",
                    std::exp(log), std::exp(kMostPadLog)));
  return log;
}

void end_at_pad(VectorXd& of_cells, const CellGrid& cells, double pad_m) {
  const auto columns = static_cast<Index>(cells.columns);
  const auto first =
      std::min(static_cast<Index>(std::ceil(pad_m / cells.row_m)), static_cast<Index>(cells.rows) - 1);
  for (Index row = 0; row < first; ++row)
    of_cells.segment(row * columns, columns) = of_cells.segment(first * columns, columns);
}

}  // namespace teletact::service
