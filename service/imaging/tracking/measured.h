// What was measured of a pair of frames, on the host: downloaded once, read by everything that comes after.
#pragma once

#include <cstdint>
#include <vector>

#include "service/imaging/tracking/displacement.h"
#include "service/imaging/tracking/frame.h"
#include "service/imaging/tracking/strain.h"

namespace teletact::service {

// Every field has grid.size() values, index i + nx j.
struct Measured {
  ImageGrid grid;
  Field axial_displacement, lateral_displacement;          // m, in the frame named by the geometry
  Field axial_displacement_std, lateral_displacement_std;  // m, standard deviations
  Field correlation;                                       // of pre and motion-compensated post
  std::vector<std::uint8_t> displacement_valid;            // displacement trusted
  Field axial_strain, lateral_strain, shear_strain;        // tensor components; NaN where not determined
  Field axial_strain_std, lateral_strain_std,
      shear_strain_std;                    // standard deviations; NaN where the strain is
  std::vector<std::uint8_t> strain_valid;  // displacement and strain trusted
  double median_correlation = 0;           // of the textured nodes
  double quality = 0;                      // of the pair, 0 to 1 (quality.h)
};

// Fills what is of the displacement, and what is of the strain with the pair's quality; `grid` and
// `median_correlation` are the caller's.
void download(const Queue&, const DisplacementEstimate&, Measured&);
void download(const Queue&, const StrainEstimate&, Measured&);

}  // namespace teletact::service
