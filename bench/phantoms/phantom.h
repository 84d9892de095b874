// The phantoms of the elastography chart (T2.7), from the simulated patient: scatterers moved by its own
// finite elements (0.5 mm squares, double precision), so that no mesh of the service made the data.
//
// 60 x 40 mm, 256 A-lines of 0.234 mm pitch, 7.3 MHz, 60 % bandwidth, 40 MHz, in the PROBE frame. One stiff
// or soft disc in the middle, 15 mm deep, in tissue of 10 kPa.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "client/patient/rf.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/tracking/frame.h"

namespace teletact::bench {

struct PhantomCase {
  double strain = 0.01;       // compression over depth
  double snr_db = 30;         // speckle over noise, RMS
  double correlation = 0.99;  // rho
  double contrast = 3;        // 1: homogeneous
  double diameter_m = 0.010;
  double tissue_width_m = 0.060;  // the window is its middle 60 mm
  bool operator==(const PhantomCase&) const = default;
};

struct Vector {
  double x = 0, y = 0;
};

struct Phantom {
  service::RfFrame pre, post;
  service::AcquisitionGeometry geometry;
  service::TissueExtent tissue;
  double force_n = 0, contact_area_m2 = 0;  // the true force of the probe
  double sensed_force_n = 0;                // what its sensor says (1 % and 2 mN)
  double inclusion_x_m = 0, inclusion_y_m = 0, diameter_m = 0, contrast = 1;  // window coordinates

  std::shared_ptr<const client::DisplacementField> field;  // LAB
  double rest_m = 0;                                       // what the PROBE frame takes off u_y

  // At a point of the window (x from the first A-line's left border).
  Vector displacement_m(double x_m, double y_m) const;
  double axial_strain(double x_m, double y_m) const;
  // Distance to the inclusion's centre over its radius.
  double radii(double x_m, double y_m) const;
};

// Tissues, and the noise-free RF of the seed used last, are kept: noise and decorrelation are drawn anew. The
// same case and seed give the same phantom.
class Phantoms {
 public:
  Phantom make(const PhantomCase&, std::uint64_t seed);
  // The whole image moved by `shift`, without any strain.
  static Phantom rigid(const Vector& shift_m, double snr_db, double correlation, std::uint64_t seed);
  // Uniform strain of both components, zero at the probe's face and on the middle line.
  static Phantom uniform(double axial_strain, double lateral_strain, double snr_db, double correlation,
                         std::uint64_t seed);

 private:
  using TissueKey = std::tuple<double, double, double>;  // contrast, diameter, width
  const client::Patient& patient(const PhantomCase&);
  std::map<TissueKey, std::unique_ptr<client::Patient>> patients_;
  std::uint64_t base_seed_ = 0;
  std::map<std::pair<TissueKey, double>, std::pair<client::ProbeState, client::RfBase>> bases_;  // and strain
};

}  // namespace teletact::bench
