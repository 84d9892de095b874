#include "client/acquire/recorded_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "client/acquire/remodulation.h"
#include "client/files/matfile.h"
#include "client/files/metaimage.h"
#include "client/files/uff.h"

namespace teletact::client {
namespace {

constexpr double kSpacingTolerance = 0.01;
constexpr double kUsualSoundSpeed = 1540;  // m/s, of soft tissue

// One frame as its file gives it.
struct Frame {
  std::size_t sample_count = 0, line_count = 0;
  std::string bytes;
  v1::DataType dtype = v1::DATA_TYPE_FLOAT32;
  std::optional<double> line_pitch_m, first_sample_depth_m, sampling_frequency_hz, sound_speed_m_s;
  std::string made;  // how, where it is not as in the file
};

bool differ(double a, double b) {
  return !(std::abs(a - b) <= kSpacingTolerance * std::abs(b));
}

void check_positive(double value, const char* option) {
  if (!(value > 0) || !std::isfinite(value))
    throw FrameInputError(fmt::format("give {}: it must be a number above 0", option));
}

void check_hertz(double value, const char* option) {
  constexpr double kLeastHz = 1000;
  check_positive(value, option);
  if (value < kLeastHz)
    throw FrameInputError(fmt::format("{} {}: give it in Hz; {} MHz is {}e6", option, value, value, value));
}

void check_sound_speed(double value, const std::string& stated_by) {
  if (!(value >= 1000 && value <= 2500))
    throw FrameInputError(fmt::format("{} {}: give it in m/s, 1000 to 2500; soft tissue has about {}",
                                      stated_by, value, kUsualSoundSpeed));
}

// Which of a file's frames.
std::size_t chosen(const std::filesystem::path& path, std::size_t frame_count,
                   std::optional<std::size_t> index, const char* index_option) {
  if (frame_count > 1 && !index)
    throw FrameInputError(
        fmt::format("give {}: {} holds {} frames", index_option, path.string(), frame_count));
  if (index.value_or(0) >= frame_count)
    throw FrameInputError(
        fmt::format("{} {}: {} holds frames 0 to {}", index_option, *index, path.string(), frame_count - 1));
  return index.value_or(0);
}

Frame read_mha_frame(const std::filesystem::path& path, std::optional<std::size_t> index,
                     const char* index_option, const RecordedFrameOptions& options) {
  const MetaImage image = read_metaimage(path);
  if (image.channels != 1 || image.size.size() < 2)
    throw FrameInputError(path.string() +
                          ": RF must be an image of samples x A-lines, or of samples x A-lines x frames");
  const std::size_t frame_count = image.size.size() > 2 ? image.size[2] : 1;
  const std::size_t which = chosen(path, frame_count, index, index_option);
  Frame frame;
  frame.sample_count = image.size[0];
  frame.line_count = image.size[1];
  const std::size_t values = frame.sample_count * frame.line_count;
  const auto bytes_of_frame = [&](const auto& samples) {
    return std::string(reinterpret_cast<const char*>(samples.data() + which * values),
                       values * sizeof samples[0]);
  };
  if (image.type == ElementType::kInt16) {
    frame.dtype = v1::DATA_TYPE_INT16;
    frame.bytes = bytes_of_frame(image.as<std::int16_t>());
  } else {
    frame.bytes = bytes_of_frame(image.as<float>());
  }
  const double unit_m = options.spacing_unit == "mm" ? 1e-3 : 1;
  if (image.spacing.size() >= 2) {
    check_sample_spacing(image.spacing[0] * unit_m, options.sound_speed_m_s.value_or(kUsualSoundSpeed),
                         options.sampling_frequency_hz, path.string());
    frame.line_pitch_m = image.spacing[1] * unit_m;
  }
  if (!image.origin.empty()) frame.first_sample_depth_m = image.origin[0] * unit_m;
  return frame;
}

Frame read_mat_frame(const std::filesystem::path& path, std::optional<std::size_t> index,
                     const char* index_option, const RecordedFrameOptions& options) {
  if (options.variable.empty())
    throw FrameInputError(
        "give --variable: which variable of the .mat file holds RF (a file of USTB is read as .uff)");
  if (options.axial_axis.empty())
    throw FrameInputError(
        "give --axial-axis rows|columns: a .mat file does not say along which axis depth runs");
  const AxialAxis axis = options.axial_axis == "rows" ? AxialAxis::kRows : AxialAxis::kColumns;
  MatFrames frames = read_mat(path, options.variable, axis);
  const std::size_t which = chosen(path, frames.frame_count, index, index_option);
  const std::size_t values = frames.sample_count * frames.line_count;
  Frame frame;
  frame.sample_count = frames.sample_count;
  frame.line_count = frames.line_count;
  frame.bytes.assign(reinterpret_cast<const char*>(frames.samples.data() + which * values),
                     values * sizeof(float));
  return frame;
}

Frame read_uff_frame(const std::filesystem::path& path, std::optional<std::size_t> index,
                     const char* index_option, const RecordedFrameOptions& options) {
  const UffImage image = read_uff(path, options.variable, index.value_or(0));
  chosen(path, image.frame_count, index, index_option);
  if (options.sound_speed_m_s && image.sound_speed_m_s &&
      differ(*options.sound_speed_m_s, *image.sound_speed_m_s))
    throw FrameInputError(
        fmt::format("--sound-speed-m-s {:.6g} contradicts {}, beamformed with {:.6g} m/s; leave it out",
                    *options.sound_speed_m_s, path.string(), *image.sound_speed_m_s));
  Frame frame;
  frame.sound_speed_m_s = image.sound_speed_m_s.value_or(options.sound_speed_m_s.value_or(kUsualSoundSpeed));
  check_sound_speed(*frame.sound_speed_m_s, path.string() + ": sound_speed");
  RfImage rf =
      rf_of(image, {options.center_frequency_hz, *frame.sound_speed_m_s, options.modulation_frequency_hz},
            path.string());
  if (options.sampling_frequency_hz != 0 && differ(options.sampling_frequency_hz, rf.sampling_frequency_hz))
    throw FrameInputError(fmt::format(
        "--sampling-frequency-hz {:.6g} contradicts {}, whose z_axis makes {:.6g} Hz of it; leave it out",
        options.sampling_frequency_hz, path.string(), rf.sampling_frequency_hz));
  frame.sampling_frequency_hz = rf.sampling_frequency_hz;
  frame.sample_count = rf.sample_count;
  frame.line_count = image.line_count;
  frame.line_pitch_m = image.line_pitch_m;
  frame.first_sample_depth_m = image.first_sample_depth_m;
  frame.bytes = bytes_of(rf.samples);
  frame.made = rf.made;
  return frame;
}

std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension;
}

Frame read_frame(const std::filesystem::path& path, std::optional<std::size_t> index,
                 const char* index_option, const RecordedFrameOptions& options) {
  const std::string extension = extension_of(path);
  if (extension == ".uff") return read_uff_frame(path, index, index_option, options);
  if (extension != ".mha" && extension != ".mat")
    throw FrameInputError(path.string() + ": not a .mha, .mat or .uff file; convert it to one of them");
  if (options.modulation_frequency_hz)
    throw FrameInputError("--modulation-frequency-hz: " + path.string() +
                          " holds RF; leave it out, it is of complex data in a .uff file");
  check_hertz(options.sampling_frequency_hz, "--sampling-frequency-hz");
  return extension == ".mha" ? read_mha_frame(path, index, index_option, options)
                             : read_mat_frame(path, index, index_option, options);
}

const char* type_name(v1::DataType type) {
  return type == v1::DATA_TYPE_INT16 ? "int16" : "float32";
}

double line_pitch_of(const Frame& pre, const RecordedFrameOptions& options) {
  if (!options.line_pitch_m && !pre.line_pitch_m)
    throw FrameInputError("give --line-pitch-m: the file has no lateral spacing");
  if (options.line_pitch_m && pre.line_pitch_m && differ(*options.line_pitch_m, *pre.line_pitch_m))
    throw FrameInputError(
        fmt::format("--line-pitch-m {:.6g} contradicts {}, which states {:.6g} m; leave it out, or "
                    "correct the file",
                    *options.line_pitch_m, options.pre.string(), *pre.line_pitch_m));
  return pre.line_pitch_m ? *pre.line_pitch_m : *options.line_pitch_m;
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
        "rests, zero "
        "at the top)");
  if (options.force_n.has_value() != options.contact_area_m2.has_value())
    throw FrameInputError(options.force_n ? "give --contact-area-m2 with --force-n, or neither"
                                          : "give --force-n with --contact-area-m2, or neither");
}

}  // namespace

void check_sample_spacing(double stated_m, double sound_speed_m_s, double sampling_frequency_hz,
                          const std::string& file) {
  const double expected_m = sound_speed_m_s / (2 * sampling_frequency_hz);
  if (!differ(stated_m, expected_m)) return;
  throw FrameInputError(fmt::format(
      "{}: its axial spacing {:.6g} m contradicts c / (2 fs) = {:.6g} m; {}", file, stated_m, expected_m,
      !differ(stated_m * 1e-3, expected_m)  ? "it looks like millimetres: give --spacing-unit mm"
      : !differ(stated_m * 1e3, expected_m) ? "it looks like metres: give --spacing-unit m"
                                            : "correct --sampling-frequency-hz, --sound-speed-m-s, "
                                              "--spacing-unit or the file"));
}

std::string modulus_doubt(double background_pa) {
  constexpr double kSoftestPa = 100, kStiffestPa = 1e6;
  const bool stiff = background_pa > kStiffestPa;
  if (!stiff && !(background_pa < kSoftestPa)) return "";
  return fmt::format(
      "background {}: no soft tissue is that {}; is --force-n in newtons, and --contact-area-m2 in square "
      "metres (1 cm^2 is 1e-4)?",
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
  Frame pre = read_frame(options.pre, options.pre_frame, "--pre-frame", options);
  Frame post = read_frame(options.post, options.post_frame, "--post-frame", options);
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
  FramePair pair;
  v1::Acquisition& acquisition = pair.acquisition;
  acquisition.set_sample_count(static_cast<std::uint32_t>(pre.sample_count));
  acquisition.set_line_count(static_cast<std::uint32_t>(pre.line_count));
  acquisition.set_dtype(pre.dtype);
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
  const bool of_planes = options.modulus_method != v1::MODULUS_METHOD_UNSPECIFIED &&
                         options.modulus_method != v1::MODULUS_METHOD_SOLID;
  acquisition.set_plane(options.plane != v1::PLANE_CONDITION_UNSPECIFIED ? options.plane
                        : of_planes                                      ? v1::PLANE_CONDITION_STRAIN
                                                                         : v1::PLANE_CONDITION_SOLID);
  acquisition.set_probe_elevation_m(options.probe_elevation_m);
  acquisition.set_modulus_time_limit_s(options.modulus_time_limit_s);
  if (options.force_n) {
    acquisition.mutable_probe_force()->set_force_n(*options.force_n);
    acquisition.mutable_probe_force()->set_contact_area_m2(*options.contact_area_m2);
  }
  pair.made = pre.made;
  pair.pre = std::move(pre.bytes);
  pair.post = std::move(post.bytes);
  return pair;
}

}  // namespace teletact::client
