#include "client/acquire/recorded_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <sstream>

#include "client/acquire/remodulation.h"
#include "client/acquire/rf_checks.h"
#include "client/files/matfile.h"
#include "client/files/metaimage.h"
#include "client/files/uff.h"
#include "client/text/shown.h"

namespace teletact::client {
namespace {

constexpr double kSpacingTolerance = 0.01;
constexpr double kUsualSoundSpeed = 1540;  // m/s, of soft tissue

// One frame as its file gives it.
struct Frame {
  std::size_t sample_count = 0, line_count = 0;
  std::vector<float> samples;
  RfAxis axis = RfAxis::kFastest;              // rf_axis() of them
  v1::DataType dtype = v1::DATA_TYPE_FLOAT32;  // of the file
  bool had_offset = false;                     // RfVerdict's
  std::optional<double> sample_pitch_m, line_pitch_m, first_sample_depth_m, sampling_frequency_hz,
      sound_speed_m_s;
  std::string kind;                 // that the file states, where it is not RF
  std::string made;                 // how, where it is not as in the file
  std::string stamp_s;              // as the file states it
  std::vector<std::string> doubts;  // a line each
};

// Which frame of which file.
struct Source {
  std::filesystem::path path;
  std::optional<std::size_t> index;
  const char* index_option;
  std::string variable;
};

double period_of(const RecordedFrameOptions& options) {
  return options.sampling_frequency_hz / options.center_frequency_hz;
}

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
std::size_t chosen(const Source& from, std::size_t frame_count) {
  if (frame_count > 1 && !from.index)
    throw FrameInputError(
        fmt::format("give {}: {} holds {} frames", from.index_option, from.path.string(), frame_count));
  const std::size_t index = from.index.value_or(0);
  if (index >= frame_count)
    throw FrameInputError(fmt::format("{} {}: {} holds frames 0 to {}", from.index_option, index,
                                      from.path.string(), frame_count - 1));
  return index;
}

// What PLUS and SUPRA say of an image's axes: the first letter of the fastest, M or U across the A-lines, F
// or N along them, away from the probe or towards it.
struct Orientation {
  std::string said;  // as it stands; empty: nothing is
  bool across = false, backwards = false;
};

Orientation orientation_of(const MetaImage& image, const std::string& file) {
  constexpr const char* kField = "UltrasoundImageOrientation";
  Orientation out{image.field(kField)};
  if (out.said.empty()) return out;
  const auto is = [&](std::size_t k, const char* letters) {
    return out.said.size() > k && std::string_view(letters).find(out.said[k]) != std::string_view::npos;
  };
  out.across = is(0, "MU");
  if (!(out.across && is(1, "FN")) && !(is(0, "FN") && is(1, "MU")))
    throw FrameInputError(
        fmt::format("{}: {} = {} is no plane of A-lines; save one whose axes are M or U, and F or N", file,
                    kField, shown(out.said)));
  out.backwards = is(out.across ? 1 : 0, "N");
  out.said = fmt::format("{} = {}", kField, shown(out.said));
  return out;
}

// Brings depth to the front: where the samples oscillate, else where the file says. Returns whether it had
// another place.
bool bring_depth_first(Frame& frame, const Orientation& orientation, double period, const std::string& file) {
  frame.axis = rf_axis(frame.samples, frame.sample_count, period);
  const bool is_told = frame.axis == RfAxis::kFastest || frame.axis == RfAxis::kSlowest;
  const bool across = is_told ? frame.axis == RfAxis::kSlowest : orientation.across;
  const char* const found = across ? "second" : "first";
  if (is_told && !orientation.said.empty() && across != orientation.across)
    frame.doubts.push_back(
        fmt::format("{}: {} contradicts its samples, which oscillate along the {} dimension: "
                    "that is taken as depth",
                    file, orientation.said, found));
  if (across && orientation.said.empty())
    frame.doubts.push_back(
        fmt::format("{}: its samples oscillate along the second dimension: that is taken as depth", file));
  if (across) {
    frame.samples = turned(frame.samples, frame.sample_count);
    std::swap(frame.sample_count, frame.line_count);
    if (is_told) frame.axis = RfAxis::kFastest;
  }
  if (orientation.backwards)
    for (std::size_t l = 0; l < frame.line_count; ++l)
      std::reverse(frame.samples.begin() + static_cast<std::ptrdiff_t>(l * frame.sample_count),
                   frame.samples.begin() + static_cast<std::ptrdiff_t>((l + 1) * frame.sample_count));
  if (!orientation.said.empty() && across == orientation.across && (across || orientation.backwards))
    frame.made = fmt::format("{}: depth runs as {} says", file, orientation.said);
  return across;
}

// MetaIO writes 1 where nothing was stated, and no scanner has metres or millimetres of it along depth.
bool states_spacing(const MetaImage& image) {
  return image.spacing.size() >= 2 && (image.spacing[0] != 1 || image.spacing[1] != 1);
}

// Some devices of PLUS, such as WinProbe, state it of each frame and not of the file.
void take_spacing_of_frame(MetaImage& image, const std::string& field, const std::string& file) {
  const std::string said = image.field(field);
  if (said.empty() || states_spacing(image)) return;
  std::istringstream in(said);
  double axial = 0, lateral = 0;
  if (!(in >> axial >> lateral) || !(axial > 0) || !(lateral > 0))
    throw FrameInputError(
        fmt::format("{}: {} = {} is no spacing; correct the header", file, field, shown(said)));
  image.spacing = {axial, lateral};
}

Frame read_mha_frame(const Source& from, const RecordedFrameOptions& options) {
  const std::string file = from.path.string();
  MetaImage image = read_metaimage(from.path);
  if (image.channels != 1 || image.size.size() < 2)
    throw FrameInputError(file +
                          ": RF must be an image of samples x A-lines, or of samples x A-lines x frames");
  const std::size_t which = chosen(from, image.size.size() > 2 ? image.size[2] : 1);
  const std::string stamped = fmt::format("Seq_Frame{:04}_", which);
  if (image.field(stamped + "ImageStatus") == "INVALID")
    throw FrameInputError(fmt::format("{}: frame {} is INVALID ({}ImageStatus); choose another with {}", file,
                                      which, stamped, from.index_option));
  take_spacing_of_frame(image, stamped + "ElementSpacing", file);
  Frame frame;
  frame.stamp_s = shown(image.field(stamped + "Timestamp"));
  frame.sample_count = image.size[0], frame.line_count = image.size[1];
  const auto values = static_cast<std::ptrdiff_t>(frame.sample_count * frame.line_count),
             begin = static_cast<std::ptrdiff_t>(which) * values;
  const std::vector<float> all = image.as<float>();
  frame.samples.assign(all.begin() + begin, all.begin() + begin + values);
  if (image.type == ElementType::kInt16) frame.dtype = v1::DATA_TYPE_INT16;
  if (const std::string kind = image.field("UltrasoundImageType"); !kind.empty() && kind != "RF_REAL")
    frame.kind = "UltrasoundImageType = " + shown(kind);
  if (bring_depth_first(frame, orientation_of(image, file), period_of(options), file))
    for (auto* list : {&image.spacing, &image.origin})
      if (list->size() >= 2) std::swap((*list)[0], (*list)[1]);
  const double unit_m = options.spacing_unit == "mm" ? 1e-3 : 1;
  if (states_spacing(image)) {
    frame.sample_pitch_m = image.spacing[0] * unit_m;
    frame.line_pitch_m = image.spacing[1] * unit_m;
  }
  if (!image.origin.empty()) frame.first_sample_depth_m = image.origin[0] * unit_m;
  return frame;
}

Frame read_mat_frame(const Source& from, const RecordedFrameOptions& options) {
  if (from.variable.empty())
    throw FrameInputError(
        "give --variable: which variable of the .mat file holds RF (a file of USTB is read as .uff)");
  if (options.axial_axis.empty())
    throw FrameInputError(
        "give --axial-axis rows|columns: a .mat file does not say along which axis depth runs");
  const bool rows = options.axial_axis == "rows";
  const MatFrames frames = read_mat(from.path, from.variable, rows ? AxialAxis::kRows : AxialAxis::kColumns);
  const auto values = static_cast<std::ptrdiff_t>(frames.sample_count * frames.line_count),
             begin = static_cast<std::ptrdiff_t>(chosen(from, frames.frame_count)) * values;
  Frame frame;
  frame.sample_count = frames.sample_count;
  frame.line_count = frames.line_count;
  frame.samples.assign(frames.samples.begin() + begin, frames.samples.begin() + begin + values);
  frame.axis = rf_axis(frame.samples, frame.sample_count, period_of(options));
  if (frame.axis == RfAxis::kSlowest)
    throw FrameInputError(fmt::format(
        "--axial-axis {}: the samples of {} do not oscillate along that axis but along the other; give "
        "--axial-axis {}",
        options.axial_axis, from.path.string(), rows ? "columns" : "rows"));
  return frame;
}

Frame read_uff_frame(const Source& from, const RecordedFrameOptions& options) {
  const std::string file = from.path.string();
  const UffImage image = read_uff(from.path, from.variable, from.index.value_or(0));
  chosen(from, image.frame_count);
  if (options.sound_speed_m_s && image.sound_speed_m_s &&
      differ(*options.sound_speed_m_s, *image.sound_speed_m_s))
    throw FrameInputError(
        fmt::format("--sound-speed-m-s {:.6g} contradicts {}, beamformed with {:.6g} m/s; leave it out",
                    *options.sound_speed_m_s, file, *image.sound_speed_m_s));
  Frame frame;
  frame.sound_speed_m_s = image.sound_speed_m_s.value_or(options.sound_speed_m_s.value_or(kUsualSoundSpeed));
  check_sound_speed(*frame.sound_speed_m_s, file + ": sound_speed");
  RfImage rf = rf_of(
      image, {options.center_frequency_hz, *frame.sound_speed_m_s, options.modulation_frequency_hz}, file);
  if (options.sampling_frequency_hz != 0 && differ(options.sampling_frequency_hz, rf.sampling_frequency_hz))
    throw FrameInputError(fmt::format(
        "--sampling-frequency-hz {:.6g} contradicts {}, whose z_axis makes {:.6g} Hz of it; leave it out",
        options.sampling_frequency_hz, file, rf.sampling_frequency_hz));
  frame.sampling_frequency_hz = rf.sampling_frequency_hz;
  frame.sample_count = rf.sample_count;
  frame.line_count = image.line_count;
  frame.line_pitch_m = image.line_pitch_m;
  frame.first_sample_depth_m = image.first_sample_depth_m;
  frame.samples = std::move(rf.samples);
  frame.axis =
      rf_axis(frame.samples, frame.sample_count, rf.sampling_frequency_hz / options.center_frequency_hz);
  if (frame.axis == RfAxis::kSlowest)
    throw FrameInputError(file +
                          ": its samples oscillate along x, not along z; write the object again, z fastest");
  frame.made = rf.made;
  return frame;
}

std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension;
}

Frame read_any(const Source& from, const RecordedFrameOptions& options) {
  const std::string extension = extension_of(from.path);
  if (extension == ".uff") return read_uff_frame(from, options);
  if (extension != ".mha" && extension != ".mhd" && extension != ".mat")
    throw FrameInputError(from.path.string() +
                          ": not a .mha, .mhd, .mat or .uff file; convert it to one of them");
  if (options.modulation_frequency_hz)
    throw FrameInputError("--modulation-frequency-hz: " + from.path.string() +
                          " holds RF; leave it out, it is of complex data in a .uff file");
  check_hertz(options.sampling_frequency_hz, "--sampling-frequency-hz");
  return extension == ".mat" ? read_mat_frame(from, options) : read_mha_frame(from, options);
}

// Of whatever format: it is RF by now, or refused.
Frame read_frame(const Source& from, const RecordedFrameOptions& options) {
  Frame frame = read_any(from, options);
  RfVerdict verdict = check_rf(frame.samples, frame.line_count, frame.axis,
                               {from.path.string(), frame.kind, options.center_frequency_hz,
                                frame.sampling_frequency_hz.value_or(options.sampling_frequency_hz)});
  frame.had_offset = verdict.had_offset;
  if (frame.sample_pitch_m)
    check_sample_spacing(*frame.sample_pitch_m, options.sound_speed_m_s.value_or(kUsualSoundSpeed),
                         options.sampling_frequency_hz, from.path.string());
  frame.doubts.insert(frame.doubts.end(), verdict.doubts.begin(), verdict.doubts.end());
  return frame;
}

std::string bytes_as(const std::vector<float>& samples, v1::DataType dtype) {
  if (dtype != v1::DATA_TYPE_INT16) return bytes_of(samples);
  return bytes_of(std::vector<std::int16_t>(samples.begin(), samples.end()));
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
  const Frame pre = read_frame({options.pre, options.pre_frame, "--pre-frame", options.variable}, options);
  const Frame post = read_frame({options.post, options.post_frame, "--post-frame",
                                 options.post_variable.empty() ? options.variable : options.post_variable},
                                options);
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
  const bool whole = pre.dtype == v1::DATA_TYPE_INT16 && !pre.had_offset && !post.had_offset;
  const v1::DataType dtype = whole ? v1::DATA_TYPE_INT16 : v1::DATA_TYPE_FLOAT32;
  FramePair pair;
  v1::Acquisition& acquisition = pair.acquisition;
  acquisition.set_sample_count(static_cast<std::uint32_t>(pre.sample_count));
  acquisition.set_line_count(static_cast<std::uint32_t>(pre.line_count));
  acquisition.set_dtype(dtype);
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
  if (!pre.stamp_s.empty() && !post.stamp_s.empty())
    pair.made +=
        fmt::format("{}frames stamped {} and {} s", pre.made.empty() ? "" : "; ", pre.stamp_s, post.stamp_s);
  pair.pre = bytes_as(pre.samples, dtype);
  pair.post = bytes_as(post.samples, dtype);
  pair.doubts = pre.doubts.empty() ? post.doubts : pre.doubts;  // two files have them alike
  const auto of_lengths = doubtful_lengths(
      {options.pre.string(), acquisition.sound_speed_m_s() / (2 * acquisition.sampling_frequency_hz()),
       acquisition.line_pitch_m(), acquisition.line_pitch_m() * acquisition.line_count(),
       options.contact_area_m2.value_or(0), options.probe_elevation_m});
  pair.doubts.insert(pair.doubts.end(), of_lengths.begin(), of_lengths.end());
  return pair;
}

}  // namespace teletact::client
