#include "service/imaging_plane/estimate_request.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/base/choices.h"
#include "service/imaging/modulus/skin.h"
#include "service/scene/errors.h"

namespace teletact::service {

EstimateSize EstimateRequest::size() const {
  const bool solid = tissue.plane == Plane::kSolid;
  return {sample_count,
          line_count,
          max_strain,
          window_width_m(),
          tissue.depth_m,
          solid ? ModulusKind::kSolid : modulus.kind.value_or(ModulusKind::kIterative),
          modulus_time_limit_s.value_or(max_modulus_s),
          scene != nullptr};
}

namespace {

void check_frames(const EstimateRequest& r, const Limits& limits) {
  require_between<std::uint64_t>("acquisition.sample_count", r.sample_count, limits.min_samples,
                                 limits.max_samples, "give the samples of one A-line");
  require_between<std::uint64_t>("acquisition.line_count", r.line_count, limits.min_lines, limits.max_lines,
                                 "give the number of A-lines");
  const AcquisitionGeometry& g = r.geometry;
  require_between("acquisition.center_frequency_hz", g.center_frequency_hz, limits.min_center_frequency_hz,
                  limits.max_center_frequency_hz,
                  "give the transducer's centre frequency in Hz (5 MHz is 5e6)");
  if (!(g.sampling_frequency_hz > 2 * g.center_frequency_hz) || !std::isfinite(g.sampling_frequency_hz))
    throw std::invalid_argument(
        fmt::format("acquisition.sampling_frequency_hz: {} is not > 2 x center_frequency_hz; give the "
                    "digitiser's rate in Hz (40 MHz "
                    "is 40e6)",
                    g.sampling_frequency_hz));
  require_between("acquisition.sound_speed_m_s", g.sound_speed_m_s, limits.min_sound_speed_m_s,
                  limits.max_sound_speed_m_s, "soft tissue is about 1540");
  require_between("acquisition.line_pitch_m", g.line_pitch_m, limits.min_line_pitch_m,
                  limits.max_line_pitch_m, "give the distance of two A-lines in metres");
  require_between("acquisition.first_sample_depth_m", g.first_sample_depth_m, 0.0,
                  limits.max_first_sample_depth_m, "give the depth of the first sample in metres");
  require_between("acquisition.line_pitch_m x line_count", r.window_width_m(), 0.0, limits.max_window_width_m,
                  "no probe is wider; give the distance of two A-lines in metres");
}

// A standard deviation within the value that it belongs to.
void check_deviation(const std::string& field, double stated, double value, const char* otherwise) {
  if (stated >= 0 && (stated == 0 || stated < value)) return;
  if (value == 0)
    throw std::invalid_argument(fmt::format(
        "acquisition.{}: {}, but what it belongs to is not stated; state that too, or leave it out", field,
        stated));
  throw std::invalid_argument(
      fmt::format("acquisition.{}: {} is not within [0, {}), the value that it belongs to; give its "
                  "standard deviation, or leave it out for {}",
                  field, stated, value, otherwise));
}

double relative(double stated, double value, double usual = 0) {
  return stated == 0 ? usual : stated / value;
}

// A force within its own noise is no mistake of who states it: the pair was pressed too little to tell one.
void check_told(const EstimateRequest& r) {
  constexpr double kReach = 5;  // deviations: so far below zero noise alone takes what a sensor shows
  const double shown_n = r.force->force_n - r.force_zero_n,
               noise_n = std::hypot(r.force_std_n, r.force_zero_std_n);
  const bool sound = r.force_std_n >= 0 && r.force_zero_std_n >= 0 && noise_n > 0 && std::isfinite(noise_n);
  if (!(sound && shown_n <= noise_n && shown_n > -kReach * noise_n)) return;
  throw Error(ErrorKind::kPrecondition,
              fmt::format("acquisition.probe_force.force_n: {:.3g} N is no more than its noise of {:.3g} N "
                          "(force_std_n, force_zero_std_n), so that the pair tells no modulus; press further "
                          "between the frames, or correct the noise",
                          shown_n, noise_n));
}

// What the sensor showed becomes the force, and what is uncertain of both its own and its shared deviation.
void settle_force(EstimateRequest& r, const Limits& limits) {
  const std::string field = "probe_force.";
  ProbeForce& force = *r.force;
  check_told(r);
  require_between("acquisition.probe_force.force_n", force.force_n, limits.min_probe_force_n,
                  limits.max_probe_force_n, "give the sensor's change from pre to post, > 0 in compression");
  // Of 0.1 mm to 0.5 m across the image plane: cm^2 or mm^2 given for m^2 lie outside.
  require_between("acquisition.probe_force.contact_area_m2", force.contact_area_m2,
                  limits.min_probe_elevation_m * r.window_width_m(),
                  limits.max_probe_elevation_m * r.window_width_m(),
                  "give the area of the probe's face that touches, the window's width times the face's "
                  "elevation, in m^2 (1 cm^2 is 1e-4)");
  if (r.force_gain == 0) r.force_gain = 1;
  require_between("acquisition.probe_force.force_gain", r.force_gain, 0.1, 10.0,
                  "give what the sensor shows of each newton, or leave it out for 1");
  if (!(std::isfinite(r.force_zero_n) && r.force_zero_n < force.force_n))
    throw std::invalid_argument(fmt::format(
        "acquisition.{}force_zero_n: {} leaves nothing of the {} N that the sensor showed; give what it "
        "shows without a load, or press further",
        field, r.force_zero_n, force.force_n));
  const double shown_n = force.force_n - r.force_zero_n;
  check_deviation(field + "force_std_n", r.force_std_n, shown_n, "3 % of it; or press further");
  check_deviation(field + "force_zero_std_n", r.force_zero_std_n, shown_n, "none of its own");
  check_deviation(field + "force_gain_std", r.force_gain_std, r.force_gain, "none of its own");
  check_deviation(field + "contact_area_std_m2", r.contact_area_std_m2, force.contact_area_m2, "5 % of it");
  const double gain = relative(r.force_gain_std, r.force_gain);
  r.area_relative_deviation = relative(r.contact_area_std_m2, force.contact_area_m2, choices::kAreaDeviation);
  force.force_n = shown_n / r.force_gain;
  require_between("acquisition.probe_force: (force_n - force_zero_n) / force_gain", force.force_n,
                  limits.min_probe_force_n, limits.max_probe_force_n, "check zero and gain");
  force.own_deviation = std::hypot(relative(r.force_std_n, shown_n, choices::kForceDeviation),
                                   relative(r.force_zero_std_n, shown_n));
  // Of a solid's face the area tells the length alone, which its fit holds.
  const bool solid = r.tissue.plane == Plane::kSolid;
  force.shared_deviation = solid ? gain : std::hypot(gain, r.area_relative_deviation);
  r.force_relative_deviation = std::hypot(force.own_deviation, gain);
}

// How the estimate is to be made.
void settle_way(EstimateRequest& r, const Limits& limits) {
  const bool solid = r.tissue.plane == Plane::kSolid;
  if (r.modulus.kind && (*r.modulus.kind == ModulusKind::kSolid) != solid)
    throw std::invalid_argument(
        "acquisition.modulus_method: SOLID goes with the plane condition SOLID, and no other method does; "
        "leave "
        "it out");
  if (solid) r.modulus.kind = ModulusKind::kSolid;
  if (!solid && (r.tissue.probe_elevation_m != 0 || r.tissue.probe_elevation_std_m != 0))
    throw std::invalid_argument(
        "acquisition.probe_elevation_m: of solid tissue alone; give plane = SOLID without another "
        "modulus_method, or leave it out");
  if (!solid && r.slice_of)
    throw std::invalid_argument(
        "acquisition.slice_of: of solid tissue alone; give plane = SOLID without another modulus_method, or "
        "leave it out");
  if (r.slice_of && r.scene)
    throw std::invalid_argument(
        "acquisition.slice_of: a pair is published into a plane scene, or is a solid's slice; leave one out");
  if (r.slice_of) {
    const std::shared_ptr<const ExplicitModulus> slices = r.slice_of->scene->solid();
    require_between("acquisition.slice_of.window.origin_m[2]", r.slice_of->z_m, slices->z_m.front(),
                    slices->z_m.back(), "give a place in the solid");
  }
  if (r.tissue.probe_elevation_m != 0)
    require_between("acquisition.probe_elevation_m", r.tissue.probe_elevation_m, limits.min_probe_elevation_m,
                    limits.max_probe_elevation_m,
                    "give the length of the probe's face across the image plane, in m");
  check_deviation("probe_elevation_std_m", r.tissue.probe_elevation_std_m, r.tissue.probe_elevation_m,
                  "the service's own");
  if (r.modulus_time_limit_s)
    require_between("acquisition.modulus_time_limit_s", *r.modulus_time_limit_s, limits.min_modulus_time_s,
                    limits.max_modulus_time_s, "leave it out for what the force needs and the time leaves");
  r.max_modulus_s = limits.max_modulus_time_s;
  if (r.max_strain == 0) r.max_strain = choices::kMaxStrain;
  require_between("acquisition.max_strain", r.max_strain, limits.min_max_strain, limits.max_max_strain,
                  fmt::format("leave it out for {}", choices::kMaxStrain).c_str());
  DisplacementOptions search;
  search.max_strain = r.max_strain;
  DisplacementEstimator::require_fits({r.sample_count, r.line_count, {}}, r.geometry, search);
  require_between("acquisition.finish_within_s", r.finish_within_s, 0.0, limits.max_finish_within_s,
                  "give seconds after the last byte, or leave it out");
}

void check_publication(const EstimateRequest& r) {
  r.scene->check_window(r.window_x_m, r.window_x_m + r.window_width_m());
  if (!r.force)
    throw std::invalid_argument(
        "acquisition.probe_force: missing; without it the modulus is relative and nothing can be published");
  if (r.tissue.plane == Plane::kStress)
    throw std::invalid_argument(
        "acquisition.plane: a scene is touched in plane strain; leave STRESS out, or publish out");
}

// What the scene states and the acquisition states otherwise: the modulus would be identified with one value
// and felt with another.
void check_agrees(const char* field, double stated, double scenes, const Scene& scene) {
  constexpr double kRounding = 1e-6;
  if (stated == 0 || std::abs(stated - scenes) <= kRounding * scenes) return;
  throw std::invalid_argument(
      fmt::format("acquisition.{}: {}, but scene {} has {} and is touched with it; leave the field out, or "
                  "publish into a scene that has the same",
                  field, stated, scene.id(), scenes));
}

void settle_surface(Surface& surface, bool solid) {
  constexpr double kMinThicknessM = 1e-5, kMaxThicknessM = kSkinLayers * kFineCellM, kMaxRatio = 20;
  if (!solid && surface.kind != Surface::Kind::kUnknown)
    throw std::invalid_argument(
        "acquisition.surface: of solid tissue alone; give plane = SOLID without another modulus_method, or "
        "leave it out");
  if (surface.kind != Surface::Kind::kCapsule) {
    for (const auto& [field, value] :
         {std::pair("capsule_thickness_m", surface.thickness_m), std::pair("capsule_ratio", surface.ratio),
          std::pair("capsule_thickness_std_m", surface.thickness_std_m),
          std::pair("capsule_ratio_std", surface.ratio_std)})
      if (value != 0)
        throw std::invalid_argument(fmt::format(
            "acquisition.{}: {}, but surface is not CAPSULE; give surface = CAPSULE, or leave it out", field,
            value));
    return;
  }
  require_between("acquisition.capsule_thickness_m", surface.thickness_m, kMinThicknessM, kMaxThicknessM,
                  "the strain shows what lies deeper; leave surface out where you do not know it");
  require_between("acquisition.capsule_ratio", surface.ratio, 1 / kMaxRatio, kMaxRatio,
                  "give the capsule's modulus over that of the tissue below");
  check_deviation("capsule_thickness_std_m", surface.thickness_std_m, surface.thickness_m, "25 % of it");
  check_deviation("capsule_ratio_std", surface.ratio_std, surface.ratio, "30 % of it");
  if (surface.thickness_std_m == 0)
    surface.thickness_std_m = choices::kCapsuleThicknessDeviation * surface.thickness_m;
  if (surface.ratio_std == 0) surface.ratio_std = choices::kCapsuleRatioDeviation * surface.ratio;
}

// Deviation of ln E by it, T3.10.
double preload_log(const EstimateRequest& r) {
  return std::hypot(r.preload_m, r.preload_std_m) / r.tissue.depth_m;
}

void settle_pad(EstimateRequest& r) {
  constexpr double kMinThicknessM = 7e-3;  // the near field and the kernel at its end leave two cells
  constexpr double kMinModulusPa = 100, kMaxModulusPa = 10e6;
  if (!r.tissue.pad) return;
  StandoffPad& pad = *r.tissue.pad;
  if (r.tissue.plane != Plane::kSolid || r.scene || r.slice_of)
    throw std::invalid_argument(
        "acquisition.pad_thickness_m: a pad is for solid tissue outside scenes, which begin at the face; "
        "give plane = SOLID without publish and slice_of, or leave it out");
  if (r.tissue.surface.kind != Surface::Kind::kUnknown)
    throw std::invalid_argument("acquisition.surface: under a pad its strain is measured; leave it out");
  const double frame_end_m =
      r.geometry.first_sample_depth_m + r.geometry.sample_pitch_m() * static_cast<double>(r.sample_count);
  const double most_m = std::min(frame_end_m, r.tissue.depth_m) / 2;
  require_between("acquisition.pad_thickness_m", pad.thickness_m, kMinThicknessM,
                  std::max(kMinThicknessM, most_m),
                  "the strain in the pad, and below it in as much tissue, tells the modulus");
  require_between("acquisition.pad_youngs_modulus_pa", pad.youngs_modulus_pa, kMinModulusPa, kMaxModulusPa,
                  "give the pad's Young's modulus in pascals");
  check_deviation("pad_thickness_std_m", pad.thickness_std_m, pad.thickness_m, "5 % of it");
  check_deviation("pad_youngs_modulus_std_pa", pad.youngs_modulus_std_pa, pad.youngs_modulus_pa, "5 % of it");
  if (pad.thickness_std_m == 0) pad.thickness_std_m = choices::kPadDeviation * pad.thickness_m;
  if (pad.youngs_modulus_std_pa == 0)
    pad.youngs_modulus_std_pa = choices::kPadDeviation * pad.youngs_modulus_pa;
  if (!r.force)
    pad.youngs_modulus_std_pa = std::hypot(pad.youngs_modulus_std_pa, preload_log(r) * pad.youngs_modulus_pa);
}

// Of a plane tissue that is not stated is taken for as wide as the frame, and as deep.
void settle_deviations(EstimateRequest& r, bool with_scene) {
  constexpr double kMaxPoissonDeviation = 0.1;  // a usual tissue's whole range
  TissueExtent& tissue = r.tissue;
  check_deviation("tissue_depth_std_m", tissue.depth_std_m, tissue.depth_stated ? tissue.depth_m : 0, "none");
  check_deviation("tissue_width_std_m", r.tissue_width_std_m,
                  tissue.beside_m || with_scene ? tissue.width_m : 0, "none");
  tissue.beside_std_m = r.tissue_width_std_m / 2;
  if (tissue.poisson_std == 0) tissue.poisson_std = choices::kPoissonDeviation;
  require_between("acquisition.poisson_ratio_std", tissue.poisson_std, 0.0, kMaxPoissonDeviation,
                  "leave it out for 0.01");
  check_deviation("sound_speed_std_m_s", r.sound_speed_std_m_s, r.geometry.sound_speed_m_s, "1.5 % of it");
  r.sound_speed_deviation =
      relative(r.sound_speed_std_m_s, r.geometry.sound_speed_m_s, choices::kSoundSpeedDeviation);
  require_between(
      "acquisition.preload_m", r.preload_m, 0.0, tissue.depth_m / 2,
      "give by how much the probe was pressed in when the pre frame was taken, in metres, or leave it out");
  require_between("acquisition.preload_std_m", r.preload_std_m, 0.0, tissue.depth_m / 2,
                  "give its standard deviation in metres, or leave it out");
  if (r.force)  // T3.10
    r.force->shared_deviation = std::hypot(r.force->shared_deviation, preload_log(r));
}

void settle_tissue(EstimateRequest& r, const Limits& limits) {
  TissueExtent& tissue = r.tissue;
  const TissueExtent stated = tissue;
  const SceneGeometry* scene = r.scene ? &r.scene->geometry() : nullptr;
  const double frame_end_m =
      r.geometry.first_sample_depth_m + r.geometry.sample_pitch_m() * static_cast<double>(r.sample_count);
  tissue.depth_stated = stated.depth_m != 0 || scene;
  if (stated.depth_m == 0) tissue.depth_m = scene ? scene->depth_m : frame_end_m;
  if (stated.poisson_ratio == 0) tissue.poisson_ratio = scene ? scene->poisson_ratio : choices::kPoissonRatio;
  require_between("acquisition.tissue_depth_m", tissue.depth_m, limits.min_tissue_depth_m,
                  limits.max_tissue_depth_m, "give the depth of the fixed far side in metres");
  require_between("acquisition.poisson_ratio", tissue.poisson_ratio, 0.0, TissueExtent::kLargestPoissonRatio,
                  "soft tissue is about 0.49; an estimate's modulus would hang on nu alone nearer to 1/2");
  constexpr double kSolidPoissonRatio = 0.499;  // beyond it single precision does not carry the forward solve
  if (tissue.plane == Plane::kSolid)
    require_between("acquisition.poisson_ratio", tissue.poisson_ratio, 0.0, kSolidPoissonRatio,
                    "a SOLID is solved up to that; soft tissue is about 0.49");
  const double width_m = r.window_width_m();
  if (scene) {
    check_agrees("tissue_depth_m", stated.depth_m, scene->depth_m, *r.scene);
    check_agrees("poisson_ratio", stated.poisson_ratio, scene->poisson_ratio, *r.scene);
    check_agrees("tissue_width_m", stated.width_m, scene->width_m, *r.scene);
    // A window may stick out of the scene by Scene::kOverhangM; the probe touches what is there.
    tissue.width_m = std::max(scene->width_m, width_m);
    tissue.window_x_m = std::clamp(r.window_x_m, 0.0, tissue.width_m - width_m);
  } else {
    if (stated.width_m == 0) tissue.width_m = width_m;
    require_between("acquisition.tissue_width_m", tissue.width_m, width_m, limits.max_tissue_width_m,
                    "the tissue is at least as wide as the window");
    tissue.window_x_m = (tissue.width_m - width_m) / 2;
    if (stated.width_m != 0) tissue.beside_m = tissue.window_x_m;
  }
  settle_deviations(r, scene);
  settle_surface(tissue.surface, tissue.plane == Plane::kSolid);
  settle_pad(r);
}

}  // namespace

void settle(EstimateRequest& request, const Limits& limits) {
  check_frames(request, limits);
  if (request.force) settle_force(request, limits);
  settle_way(request, limits);
  if (request.scene) check_publication(request);
  settle_tissue(request, limits);
  TissueExtent& tissue = request.tissue;
  if (tissue.plane != Plane::kSolid || tissue.probe_elevation_m > 0 || !request.force) return;
  tissue.probe_elevation_m = request.force->contact_area_m2 / request.window_width_m();
  tissue.probe_elevation_std_m = request.area_relative_deviation * tissue.probe_elevation_m;
}

std::vector<std::string> warnings_of(const Estimate& e) {
  std::vector<std::string> lines;
  for (const auto& warnings : {e.input_warnings, e.modulus.warnings})
    for (const Warning& warning : warnings) lines.push_back(warning.line());
  return lines;
}

WindowEstimate window_of(const EstimateRequest& request, const Estimate& e,
                         std::chrono::steady_clock::time_point received) {
  WindowEstimate window{request.window_x_m,
                        request.window_width_m(),
                        e.grid,
                        e.modulus.youngs_modulus,
                        e.valid,
                        e.modulus.log_deviation,
                        e.b_mode};
  WindowEvidence& evidence = window.evidence;
  evidence.warnings = warnings_of(e);
  evidence.correlation_m = e.modulus.correlation_m;
  evidence.force_relative_deviation = request.force_relative_deviation;
  evidence.area_relative_deviation = request.area_relative_deviation;
  evidence.common_deviation = e.modulus.common_deviation;
  evidence.background_modulus_pa = e.modulus.background;
  evidence.quality = e.quality;
  evidence.taken_in = received;
  return window;
}

}  // namespace teletact::service
