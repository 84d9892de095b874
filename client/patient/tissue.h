// What the simulated patient is made of: a tissue file, its checks, its true modulus, and random patients.
// Axes as in theory: x from the tissue's left surface corner, y depth. The tissue is 0 <= x <= width_m,
// 0 <= y <= depth_m, bonded below, free at its sides.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace teletact::client {

// One line for the user, naming the key (and the file when there is one) and the remedy.
struct TissueError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// A stiff or soft lump with a sharp border: modulus = contrast times the background's inside it. A disc of
// plane tissue; of a solid a cylinder along z, or a sphere.
struct Inclusion {
  double x_m = 0, y_m = 0;  // centre
  double diameter_m = 0;
  double contrast = 1;
  bool sphere = false;
  double z_m = 0;  // centre of a sphere, from the image plane
  bool operator==(const Inclusion&) const = default;
};

// The probe: flat, rigid, frictionless, `lines` A-lines across its width; its force sensor.
struct Probe {
  double width_m = 0.060;
  std::size_t lines = 256;
  double elevation_m = 0.010;     // out-of-plane length of its face: contact area = width x elevation
  double compression_m = 0.0004;  // pressed between pre and post frame; in a file also as compression_strain
  double force_noise_relative = 0.01;               // standard deviation of the sensor: of the force ...
  double force_noise_n = 0.002;                     // ... and in N; independent, added
  double force_gain_error = 0;                      // the sensor shows 1 + it times the force
  double force_zero_n = 0;                          // by how much its zero drifts between the two frames
  double force_gain_std = 0, force_zero_std_n = 0;  // what the sensor states of both, standard deviations
  double line_pitch_m() const { return width_m / static_cast<double>(lines); }
  double contact_area_m2() const { return width_m * elevation_m; }
  bool operator==(const Probe&) const = default;
};

// T2.7. bandwidth is the -6 dB full width of the (Gaussian) pulse-echo spectrum over the centre frequency.
struct Ultrasound {
  double center_frequency_hz = 7.3e6;
  double bandwidth = 0.6;
  double sampling_frequency_hz = 40e6;
  double sound_speed_m_s = 1540;
  double f_number = 2;        // lateral FWHM = wavelength x f_number
  double snr_db = 30;         // RMS of the speckle over RMS of the noise
  double correlation = 0.99;  // between pre and post speckle, 1 = the same scatterers
  double depth_m = 0;         // imaged; 0: all of the tissue
  // Across the image plane: FWHM of the beam at its focus, pulse-echo; 0: only what lies in the plane echoes.
  double elevation_beam_m = 0;
  // At depth y both widths of the beam are sqrt(1 + (beam_growth (y / focus_m - 1))^2) of those at the focus.
  double focus_m = 0.020, beam_growth = 0;
  // One way, in proportion to frequency. Amplified by what it takes from the centre frequency, so that the
  // noise grows with depth instead; the pulse's spectrum is what is left of it.
  double attenuation_db_cm_mhz = 0;
  double wavelength_m() const { return sound_speed_m_s / center_frequency_hz; }
  double sample_pitch_m() const { return sound_speed_m_s / (2 * sampling_frequency_hz); }
  bool operator==(const Ultrasound&) const = default;
};

// Standard deviation (Hz) of the amplitude of the pulse's spectrum.
double spectrum_sigma_hz(const Ultrasound& u);
// What attenuation takes from the amplitude of an echo, there and back: nepers per metre of depth and Hz.
double attenuation_per_m_hz(const Ultrasound& u);
// Of the echoes from a depth, Hz: the middle of a Gaussian spectrum that attenuation has tilted.
double centre_frequency_hz(const Ultrasound& u, double depth_m);

// What the bottom of a solid rests on.
enum class Support {
  kBonded,
  kSliding,  // it stays level, and is free to slide
  kBed       // bonded to a layer that is bonded to a rigid ground
};

const char* name_of(Support);  // as a tissue file has it

// Solid tissue: what it has beside plane tissue, and how the probe meets it. Lengths along z, across the
// image plane, are from that plane. Its sides and ends are free.
struct Solid {
  double elevational_width_m = 0.100;  // from -half of it to half of it
  Support support = Support::kBonded;
  double bed_depth_m = 0.010, bed_modulus_pa = 2e3;
  double friction = 0;  // Coulomb's coefficient under the face; infinite: it holds the tissue
  // The right end of the face is pushed by 1 + uneven of what its middle is, the left one by 1 - uneven.
  double uneven = 0;
  // Before the push the middle of the face is pressed in by preload_m, its right end by lean_m more, its left
  // end by lean_m less: where it then does not touch, it never does.
  double preload_m = 0.0015, lean_m = 0;
  double capsule_m = 0, capsule_contrast = 1;  // a layer at the surface, times the background
  // The background at depth y is times this to the power y / depth, lumps and capsule with it.
  double bottom_contrast = 1;
  // Standard deviation of ln E, Gaussian with correlation exp(-d^2 / 2 length^2); the tissue's seed draws it.
  double texture = 0, texture_length_m = 0.004;
  bool operator==(const Solid&) const = default;
};

struct Tissue {
  double width_m = 0.300, depth_m = 0.040;
  double youngs_modulus_pa = 10e3;  // of the background
  double poisson_ratio = 0.49;
  double thickness_m = 0.010;  // out-of-plane contact width of the finger (theory, Axes)
  std::vector<Inclusion> inclusions;
  Probe probe;
  Ultrasound ultrasound;
  std::optional<Solid> solid;  // empty: plane strain
  std::uint64_t seed = 1;      // of scatterers, noise, sensor and texture

  double imaged_depth_m() const { return ultrasound.depth_m > 0 ? ultrasound.depth_m : depth_m; }
  // Young's modulus (Pa) at a point, without texture (TrueModulus); where lumps overlap the later one counts.
  double true_modulus(double x_m, double y_m, double z_m = 0) const;
  bool operator==(const Tissue&) const = default;
};

// Throws TissueError naming the key.
void validate(const Tissue& tissue);

// Reads a TOML tissue file; every key is optional (defaults above), an unknown one is an error. Keys:
//   seed; [tissue] width_m, depth_m, youngs_modulus_pa, poisson_ratio, thickness_m;
//   [[inclusion]] position_m = [x, y] or [x, y, z], diameter_m, contrast, shape = "cylinder" or "sphere";
//   [probe] width_m, lines, elevation_m, compression_m or compression_strain (of depth_m),
//           force_noise_relative, force_noise_n, force_gain_error, force_zero_n, force_gain_std,
//           force_zero_std_n;
//   [ultrasound] center_frequency_hz, bandwidth, sampling_frequency_hz, sound_speed_m_s, f_number, snr_db,
//                correlation, depth_m, elevation_beam_m, focus_m, beam_growth, attenuation_db_cm_mhz;
//   [solid] (makes the tissue a solid) elevational_width_m, support = "bonded", "sliding" or "bed",
//           bed_depth_m, bed_modulus_pa, friction (inf: held), uneven, preload_m, lean_m, capsule_m,
//           capsule_contrast, bottom_contrast, texture, texture_length_m
Tissue read_tissue(const std::filesystem::path& path);
Tissue parse_tissue(const std::string& toml, const std::string& name = "tissue");

// Writes a file that read_tissue gives back exactly. Throws FileError.
void write_tissue(const std::filesystem::path& path, const Tissue& tissue);

// A patient of 300 x 40 mm with 3 to 5 hidden inclusions: contrast 3 to 10, diameter 8 to 15 mm, wholly
// within 25 mm of the surface, borders >= 15 mm apart, of different size, depth and contrast; one lies across
// a border of two 60 mm windows (x = 60 k mm). The same seed gives the same patient.
Tissue random_tissue(std::uint64_t seed);

// A solid of 120 x 40 x 100 mm, texture of 5 %, with 3 hidden spheres: contrast 3 to 6, diameter 8 to 12 mm,
// wholly within 20 mm of the surface, at most 18 mm from the middle along x and along z, borders >= 6 mm
// apart. The same seed gives the same solid.
Tissue random_solid_tissue(std::uint64_t seed);

// A solid unlike what an estimator assumes, all of it drawn: size (one in four no wider than the probe),
// support, friction, an uneven push, in part without contact, capsule, texture, Poisson's ratio, a lump of 10
// mm (sphere or cylinder, 12 to 18 mm deep; `contrast` of it, drawn from 2 to 6 where that is 0), beam,
// attenuation, the sensor's gain (3 %) and zero. 40 mm are imaged. The same seed gives the same solid.
Tissue unlike_model(std::uint64_t seed, double contrast = 0);

}  // namespace teletact::client
