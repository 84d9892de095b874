// Young's modulus from strain (T3). One interface for every method; today: the reference stress (T3.1).
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "service/device/device.h"
#include "service/imaging/displacement.h"
#include "service/imaging/frame.h"
#include "service/imaging/strain.h"

namespace teletact::service {

// What a method may use; everything on the same image grid.
struct ModulusInput {
  const ImageGrid& grid;
  const DisplacementEstimate& displacement;
  const StrainEstimate& strain;
  double window_width_m;  // lines * pitch: the probe's face
  TissueExtent tissue;
  std::optional<ProbeForce> force;  // absent: relative modulus
  KnownModulus known;               // beside the window; empty: unknown; not used for a relative modulus
};

struct ModulusEstimate {
  Field youngs_modulus;  // Pa, or relative (median 1); NaN where nothing can be said
  bool absolute = false;
  double background = 0;         // median over the nodes that say something, Pa or 1
  double mean_axial_strain = 0;  // median over the trusted nodes, negative in compression
};

// The pair shows less strain than can be measured.
struct NoCompression : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class ModulusMethod {
 public:
  virtual ~ModulusMethod() = default;
  // Throws NoCompression; std::invalid_argument for an unusable tissue extent or force (field named).
  virtual ModulusEstimate estimate(const ModulusInput&) = 0;
};

struct ReferenceStressOptions {
  int corrections = 3;         // times that the reference is solved again with the modulus found so far
  double least_strain = 2e-4;  // magnitude; below it a node says nothing
  double range = 20;           // of E over its median, either way
  // Part of the median homogeneous strain below which nothing is said: near the bonded bottom and its corners
  // the probe hardly strains the tissue, and the corrections would amplify any error there.
  double least_reference = 0.5;
  double near_field_m = 1e-3;  // depth in which nothing is said: strain kernels are cut there
  int median_radius = 2;       // nodes
};

// T3.1; kernels/modulus.cl and StripModel. E = (P / P_ref) E_ref eps_ref / eps_yy, at first with homogeneous
// tissue as the reference, then (`corrections`) with the modulus found so far: the stress that stiff
// inclusions draw to themselves, and the plane-strain contrast (C + 1) / 2 of T3.1, are corrected.
std::unique_ptr<ModulusMethod> make_reference_stress(Queue, ReferenceStressOptions);

}  // namespace teletact::service
