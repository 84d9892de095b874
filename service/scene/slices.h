// Plane maps of a solid's modulus that come one by one (T8.7).
#pragma once

#include <cmath>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service/base/limits.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/scene/felt_elements.h"
#include "service/scene/geometry.h"
#include "service/scene/scene_record.h"

namespace teletact::service {

// Closer to each other they are the same slice: the newer one takes the older one's place.
inline constexpr double kSameSliceM = 1e-5;

struct ModulusSlice {
  double z_m = 0;
  // Nodes, which must be the solid's own; both empty: they are.
  std::vector<double> x_m, y_m;
  std::vector<double> youngs_modulus_pa;   // of each element between them, x fastest; > 0
  std::vector<double> log_deviation = {};  // standard deviation of ln E of each; empty: exact
  // Its changes by one deviation of each cause that is wrong in many places at once, one after another; what
  // they leave is known place by place. Empty: nothing is known of that, all may be wrong alike.
  std::vector<float> log_modes = {};
};

// Of a slice, at most.
inline constexpr std::size_t kMaxLogModes = 32;

// All of them, in any order, on the nodes of `grid`. Throws std::invalid_argument (field named: slices[n])
// for none, two at one place, one beside the grid or on another, a modulus that is none; Error(kExhausted)
// for more than the limits allow.
ExplicitModulus stacked(ExplicitModulus grid, const std::vector<ModulusSlice>& slices, const Limits&);

struct GrownModulus {
  ExplicitModulus modulus;
  std::size_t slice = 0;  // the new one's
};
// A solid with one more slice, or with this one in the place of the one there. Throws as stacked() does, the
// fields being of `slice`.
GrownModulus with_slice(const ExplicitModulus&, const ModulusSlice&, const Limits&);

// Young's moduli, Pa, that a model can be made of. Throws std::invalid_argument, field[n] named.
void check_moduli(const std::string& field, const std::vector<double>& youngs_modulus_pa);

// Whether a solid's modulus is the same for every z.
bool extruded(const ExplicitModulus&);

// A place between two slices: how far it is from the one to the other.
struct Between {
  std::size_t before = 0, after = 0;
  double share = 0;
};
Between between(const ExplicitModulus&, double z_m);

// Standard deviations of ln E as a contact feels it (T9.4), of the mean with the elements' shares of its
// force: by what was measured there, and of what lies between a solid's slices.
struct FeltDeviation {
  double measured = 0, between = 0;
  double all() const { return std::hypot(measured, between); }
};
// None where the modulus was given throughout.
std::optional<FeltDeviation> felt_log_deviation(const ExplicitModulus&, const FeltPlace&);

// The slices of a solid nearest to z, but for one there, as one sees them whose window begins at x.
std::vector<SliceBeside> slices_beside(const std::shared_ptr<const ExplicitModulus>&, double x_m, double z_m);

// How far z is from the nearest slice; 0 within half a spacing of the solid's nodes, and where the modulus is
// given throughout.
double from_slices_m(const ExplicitModulus&, double z_m);

// A slice that is not there.
struct SliceWish {
  double z_m = 0;
  double half_width = 0;  // of the 95 % interval that the modulus leaves of a force, over the force
  bool operator==(const SliceWish&) const = default;
};
// The one that would make this half width there smaller by more than `tolerance` (none: as usual, by what the
// slices state there): in the middle of the elements around z, where none is. None where the slices reach, or
// are what is not known well.
std::optional<SliceWish> wished_slice(const ExplicitModulus&, const FeltPlace&,
                                      const std::optional<double>& tolerance);

// Of the scene's size: so far nodes may begin and end beside it, by rounding.
constexpr double kNodesSlack = 1e-6;

// Whether a scene can be made of a modulus: one that a client gives, or one that was kept on disk. Throws
// std::invalid_argument (field named as in CreateScene), Error(kExhausted) beyond the limits.
void check_modulus(const ExplicitModulus&, const SceneGeometry&, const Limits&);

}  // namespace teletact::service
