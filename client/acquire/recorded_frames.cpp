#include "client/acquire/recorded_frames.h"

#include <fmt/format.h>

#include <cmath>

#include "client/acquire/frame_files.h"

namespace teletact::client {
namespace {

std::string bytes_as(const std::vector<float>& samples, v1::DataType dtype) {
  if (dtype != v1::DATA_TYPE_INT16) return bytes_of(samples);
  return bytes_of(std::vector<std::int16_t>(samples.begin(), samples.end()));
}

const char* type_name(v1::DataType type) {
  return type == v1::DATA_TYPE_INT16 ? "int16" : "float32";
}

double line_pitch_of(const RecordedFrame& pre, const RecordedFrameOptions& options) {
  if (!options.line_pitch_m && !pre.line_pitch_m)
    throw FrameInputError("give --line-pitch-m: the file has no lateral spacing");
  if (options.line_pitch_m && pre.line_pitch_m && differ(*options.line_pitch_m, *pre.line_pitch_m))
    throw FrameInputError(
        fmt::format("--line-pitch-m {:.6g} contradicts {}, which states {:.6g} m; leave it out, or "
                    "correct the file",
                    *options.line_pitch_m, options.pre.string(), *pre.line_pitch_m));
  return pre.line_pitch_m ? *pre.line_pitch_m : *options.line_pitch_m;
}

v1::PlaneCondition plane_of(const RecordedFrameOptions& options) {
  if (options.plane != v1::PLANE_CONDITION_UNSPECIFIED) return options.plane;
  return options.modulus_method == v1::MODULUS_METHOD_UNSPECIFIED ||
                 options.modulus_method == v1::MODULUS_METHOD_SOLID
             ? v1::PLANE_CONDITION_SOLID
             : v1::PLANE_CONDITION_STRAIN;
}

// What must be known before any file is opened.
void check_options(const RecordedFrameOptions& options) {
  check_hertz(options.center_frequency_hz, "--center-frequency-hz");
  if (options.modulation_frequency_hz &&
      !(*options.modulation_frequency_hz >= 0 && std::isfinite(*options.modulation_frequency_hz)))
    throw FrameInputError(fmt::format("--modulation-frequency-hz {}: give it in Hz, 0 or more",
                                      *options.modulation_frequency_hz));
  if (options.sound_speed_m_s) check_sound_speed(*options.sound_speed_m_s, "--sound-speed-m-s");
  if (!(options.poisson_ratio > 0 && options.poisson_ratio <= 0.49999))
    throw FrameInputError(
        fmt::format("--poisson-ratio {}: give it above 0 and at most 0.49999; soft tissue has about 0.49",
                    options.poisson_ratio));
  if (!(options.max_strain >= 0.001 && options.max_strain <= 0.125))
    throw FrameInputError(fmt::format(
        "--max-strain {}: give it from 0.001 to 0.125; 0.05 covers usual compression", options.max_strain));
  if (options.line_pitch_m) check_positive(*options.line_pitch_m, "--line-pitch-m");
  if (options.frame != "LAB" && options.frame != "PROBE")
    throw FrameInputError(
        "give --frame LAB (the far side rests, displacement largest at the top) or PROBE (the probe face "
        "rests, zero at the top)");
  if (options.probe_elevation_m > 0 && plane_of(options) != v1::PLANE_CONDITION_SOLID)
    throw FrameInputError(options.plane == v1::PLANE_CONDITION_UNSPECIFIED
                              ? "--probe-elevation-m: for solid tissue only, and this --modulus-method is "
                                "for plane strain; leave one of the two out"
                              : "--probe-elevation-m: for solid tissue only; leave it out, or --plane");
}

void check_alike(const RecordedFrame& pre, const RecordedFrame& post) {
  if (pre.sample_count != post.sample_count || pre.line_count != post.line_count)
    throw FrameInputError(fmt::format("--pre has {} samples x {} lines, --post {} x {}: they must be equal",
                                      pre.sample_count, pre.line_count, post.sample_count, post.line_count));
  if (pre.dtype != post.dtype)
    throw FrameInputError(fmt::format("--pre holds {} samples, --post {}: give two files of the same type",
                                      type_name(pre.dtype), type_name(post.dtype)));
  if (pre.line_pitch_m && post.line_pitch_m && differ(*post.line_pitch_m, *pre.line_pitch_m))
    throw FrameInputError("--pre and --post state different lateral spacings");
  if (pre.sampling_frequency_hz.value_or(0) != post.sampling_frequency_hz.value_or(0) ||
      pre.sound_speed_m_s.value_or(0) != post.sound_speed_m_s.value_or(0) ||
      pre.first_sample_depth_m.value_or(0) != post.first_sample_depth_m.value_or(0))
    throw FrameInputError(
        "--pre and --post state different depths or sound speeds: give frames of one beamforming");
}

// All but the type of the samples.
v1::Acquisition acquisition_of(const RecordedFrame& pre, const RecordedFrameOptions& options) {
  v1::Acquisition acquisition;
  acquisition.set_sample_count(static_cast<std::uint32_t>(pre.sample_count));
  acquisition.set_line_count(static_cast<std::uint32_t>(pre.line_count));
  acquisition.set_center_frequency_hz(options.center_frequency_hz);
  acquisition.set_sampling_frequency_hz(pre.sampling_frequency_hz.value_or(options.sampling_frequency_hz));
  acquisition.set_sound_speed_m_s(
      pre.sound_speed_m_s.value_or(options.sound_speed_m_s.value_or(kUsualSoundSpeed)));
  acquisition.set_line_pitch_m(line_pitch_of(pre, options));
  acquisition.set_first_sample_depth_m(pre.first_sample_depth_m.value_or(0));
  acquisition.set_displacement_frame(options.frame == "LAB" ? v1::DISPLACEMENT_FRAME_LAB
                                                            : v1::DISPLACEMENT_FRAME_PROBE);
  acquisition.set_max_strain(options.max_strain);
  acquisition.set_poisson_ratio(options.poisson_ratio);
  acquisition.set_tissue_depth_m(options.tissue_depth_m);
  acquisition.set_tissue_width_m(options.tissue_width_m);
  acquisition.set_modulus_method(options.modulus_method);
  acquisition.set_plane(plane_of(options));
  acquisition.set_probe_elevation_m(options.probe_elevation_m);
  acquisition.set_modulus_time_limit_s(options.modulus_time_limit_s);
  if (options.force_n) {
    acquisition.mutable_probe_force()->set_force_n(*options.force_n);
    acquisition.mutable_probe_force()->set_contact_area_m2(options.contact_area_m2.value());
  }
  acquisition.MergeFrom(options.stated);
  return acquisition;
}

}  // namespace

std::string modulus_doubt(double background_pa) {
  constexpr double kSoftestPa = 100, kStiffestPa = 1e6;
  const bool stiff = background_pa > kStiffestPa;
  if (!stiff && !(background_pa < kSoftestPa)) return "";
  return fmt::format(
      "background {}: no soft tissue is that {}; is --force-n in newtons, and --contact-area-m2 in square "
      "metres (1 cm^2 is 1e-4), or a pad's modulus in pascals?",
      stiff ? fmt::format("{:.0f} kPa", 1e-3 * background_pa) : fmt::format("{:.3g} Pa", background_pa),
      stiff ? "stiff" : "soft");
}

TissueExtent tissue_extent(const v1::Acquisition& acquisition) {
  const double sample_pitch_m = acquisition.sound_speed_m_s() / (2 * acquisition.sampling_frequency_hz());
  TissueExtent extent{acquisition.tissue_width_m(), acquisition.tissue_depth_m()};
  if (acquisition.plane() == v1::PLANE_CONDITION_SOLID) return extent;
  extent.width_assumed = extent.width_m == 0;
  extent.depth_assumed = extent.depth_m == 0;
  if (extent.width_assumed) extent.width_m = acquisition.line_count() * acquisition.line_pitch_m();
  if (extent.depth_assumed)
    extent.depth_m = acquisition.first_sample_depth_m() + acquisition.sample_count() * sample_pitch_m;
  return extent;
}

FramePair read_recorded_frames(const RecordedFrameOptions& options) {
  check_options(options);
  const RecordedFrame pre =
      read_frame({options.pre, options.pre_frame, "--pre-frame", options.variable}, options);
  const RecordedFrame post =
      read_frame({options.post, options.post_frame, "--post-frame",
                  options.post_variable.empty() ? options.variable : options.post_variable},
                 options);
  check_alike(pre, post);
  const bool whole = pre.dtype == v1::DATA_TYPE_INT16 && !pre.had_offset && !post.had_offset;
  FramePair pair;
  pair.acquisition = acquisition_of(pre, options);
  pair.acquisition.set_dtype(whole ? v1::DATA_TYPE_INT16 : v1::DATA_TYPE_FLOAT32);
  pair.made = pre.made;
  if (!pre.stamp_s.empty() && !post.stamp_s.empty())
    pair.made +=
        fmt::format("{}frames stamped {} and {} s", pre.made.empty() ? "" : "; ", pre.stamp_s, post.stamp_s);
  pair.pre = bytes_as(pre.samples, pair.acquisition.dtype());
  pair.post = bytes_as(post.samples, pair.acquisition.dtype());
  pair.doubts = pre.doubts.empty() ? post.doubts : pre.doubts;  // two files have them alike
  const double line_pitch_m = pair.acquisition.line_pitch_m();
  const auto of_lengths =
      doubtful_lengths({options.pre.string(),
                        pair.acquisition.sound_speed_m_s() / (2 * pair.acquisition.sampling_frequency_hz()),
                        line_pitch_m, line_pitch_m * static_cast<double>(pre.line_count),
                        options.contact_area_m2.value_or(0), options.probe_elevation_m});
  pair.doubts.insert(pair.doubts.end(), of_lengths.begin(), of_lengths.end());
  return pair;
}

}  // namespace teletact::client
