// The tissue under a probe as a forward model in three dimensions (T3.6): which strain a modulus would have
// shown in the image plane. Two kinds: a solid, into which the load spreads beside the probe and across the
// plane, so that strain falls with depth; and a block as wide as the probe, whose strain does not.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <memory>
#include <vector>

#include "service/device/queue.h"
#include "service/imaging/modulus/strip_model.h"

namespace teletact::service {

// The probe's face, width_m along the image and elevation_m across it, on tissue that is depth_m deep; the
// image shows image_depth_m of it.
struct ProbeFace {
  double width_m = 0, elevation_m = 0, depth_m = 0, image_depth_m = 0;
  double poisson_ratio = 0.49;
  // Where a solid ends, free of stress, from the face's border; and whether it slides on what it lies
  // on, else it is bonded.
  double beside_m = std::numeric_limits<double>::infinity();
  bool slides = false;
  // Of a pad between face and tissue (0: none), and ln of its modulus over that of the tissue.
  double pad_m = 0, pad_log = 0;
  bool goes_on() const { return beside_m == std::numeric_limits<double>::infinity(); }
  bool operator==(const ProbeFace&) const = default;
};

// Cells of the image plane under the face, index i + columns j: centres at first_x_m + i spacing_m of the
// window and (j + 1/2) row_m below the face.
struct CellGrid {
  std::size_t columns = 0, rows = 0;
  double first_x_m = 0, spacing_m = 0, row_m = 0;
  std::size_t size() const { return columns * rows; }
  double x_m(std::size_t cell) const { return first_x_m + spacing_m * static_cast<double>(cell % columns); }
  std::size_t row(std::size_t cell) const { return cell / columns; }
  double y_m(std::size_t cell) const { return row_m * (static_cast<double>(row(cell)) + 0.5); }
};

// Used by one thread at a time.
class ProbedTissue {
 public:
  virtual ~ProbedTissue() = default;
  const CellGrid& cells() const { return cells_; }
  // Strain of the cells per metre that the face's middle is pushed down: axial < 0.
  struct Response {
    Eigen::VectorXd axial_strain, lateral_strain;
    double force_n = 0;  // on the face, > 0
  };
  // ln(E / Pa) of the same cells in another plane, offset_m across the image.
  struct ImagePlane {
    double offset_m = 0;
    Eigen::VectorXd log_modulus;
  };
  using Planes = std::vector<ImagePlane>;  // by offset_m, none nearer than nearest_plane_m()
  // Under a frictionless face in whole contact, pushed by 1 + tilt (2 x / width - 1). `log_modulus`: ln(E /
  // Pa) of the cells; across the image what differs more from 0, the background, changes to the next plane's
  // with the square of the way (a lump's own slice shows it whole, the next its rim); beyond the last, and
  // without any, it does not change; beside the cells mirrored, then the row's mean; below them the last
  // row's, soon its mean.
  virtual Response push(const Eigen::VectorXd& log_modulus, double tilt = 0, const Planes& beside = {}) = 0;
  // The same after a push that differed little, from whose answer fewer iterations find it.
  virtual Response push_again(const Eigen::VectorXd& log_modulus, double tilt, const Planes& beside) {
    return push(log_modulus, tilt, beside);
  }
  Response push_homogeneous(double tilt = 0) {
    return push(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(cells_.size())), tilt);
  }
  // How far from the image another plane must be at least to be told from it; none ever is: infinity.
  virtual double nearest_plane_m() const { return std::numeric_limits<double>::infinity(); }
  // The force of push() over that of tissue that goes on for ever.
  virtual double force_share() { return 1; }

 protected:
  CellGrid cells_;
};

// Side of the cells, about: of the model in which a modulus is found, and of those that tell tissues apart.
inline constexpr double kFineCellM = 1e-3, kCoarseCellM = 2e-3;

// Of a solid under this face. Throws std::invalid_argument for a face without a size.
CellGrid cells_under(const ProbeFace&, double cell_m);
// T8's finite elements: what lies beyond a solid's end gives way; what slides lies on rollers. Where `last`
// is on the same mesh it shares its solver. Throws std::invalid_argument naming what is unusable,
// DeviceError.
std::shared_ptr<ProbedTissue> make_probed_solid(const Queue&, const ProbeFace&, double cell_m = kFineCellM,
                                                std::shared_ptr<ProbedTissue> last = {});
// Ends where the probe does, free of stress there and across the plane; its far side lies so deep that the
// image does not show it (StripModel in plane stress). It has no planes beside the image.
std::unique_ptr<ProbedTissue> make_probed_block(const ProbeFace&, StripCache&, double cell_m = kFineCellM);

}  // namespace teletact::service
