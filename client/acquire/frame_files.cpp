#include "client/acquire/frame_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string_view>

#include "client/acquire/remodulation.h"
#include "client/files/matfile.h"
#include "client/files/metaimage.h"
#include "client/files/uff.h"
#include "client/text/shown.h"

namespace teletact::client {
namespace {

double period_of(const RecordedFrameOptions& options) {
  return options.sampling_frequency_hz / options.center_frequency_hz;
}

// The spacing of samples that the file states must be c / (2 fs), within 1 %.
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

// Which of a file's frames.
std::size_t chosen(const FrameChoice& from, std::size_t frame_count) {
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
        fmt::format("{}: {} = {} is not a plane of A-lines; save one with axes M or U, and F or N", file,
                    kField, shown(out.said)));
  out.backwards = is(out.across ? 1 : 0, "N");
  out.said = fmt::format("{} = {}", kField, shown(out.said));
  return out;
}

// Brings depth to the front: where the samples oscillate, else where the file says. Returns whether it had
// another place.
bool bring_depth_first(RecordedFrame& frame, const Orientation& orientation, double period,
                       const std::string& file) {
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
        fmt::format("{}: {} = {} is not a spacing; correct the header", file, field, shown(said)));
  image.spacing = {axial, lateral};
}

RecordedFrame read_mha_frame(const FrameChoice& from, const RecordedFrameOptions& options) {
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
  RecordedFrame frame;
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

// For files that say themselves which dimension is depth.
void require_along_depth(RecordedFrame& frame, double period, const std::string& refusal) {
  frame.axis = rf_axis(frame.samples, frame.sample_count, period);
  if (frame.axis == RfAxis::kSlowest) throw FrameInputError(refusal);
}

RecordedFrame read_mat_frame(const FrameChoice& from, const RecordedFrameOptions& options) {
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
  RecordedFrame frame;
  frame.sample_count = frames.sample_count;
  frame.line_count = frames.line_count;
  frame.samples.assign(frames.samples.begin() + begin, frames.samples.begin() + begin + values);
  require_along_depth(
      frame, period_of(options),
      fmt::format("--axial-axis {}: the samples of {} do not oscillate along that axis but along the other; "
                  "give --axial-axis {}",
                  options.axial_axis, from.path.string(), rows ? "columns" : "rows"));
  return frame;
}

RecordedFrame read_uff_frame(const FrameChoice& from, const RecordedFrameOptions& options) {
  const std::string file = from.path.string();
  const UffImage image = read_uff(from.path, from.variable, from.index.value_or(0));
  chosen(from, image.frame_count);
  if (options.sound_speed_m_s && image.sound_speed_m_s &&
      differ(*options.sound_speed_m_s, *image.sound_speed_m_s))
    throw FrameInputError(
        fmt::format("--sound-speed-m-s {:.6g} contradicts {}, beamformed with {:.6g} m/s; leave it out",
                    *options.sound_speed_m_s, file, *image.sound_speed_m_s));
  RecordedFrame frame;
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
  require_along_depth(
      frame, rf.sampling_frequency_hz / options.center_frequency_hz,
      file + ": its samples oscillate along x, not along z; write the object again, z fastest");
  frame.made = rf.made;
  return frame;
}

std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension;
}

RecordedFrame read_any(const FrameChoice& from, const RecordedFrameOptions& options) {
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

}  // namespace

bool differ(double a, double b) {
  constexpr double kTolerance = 0.01;
  return !(std::abs(a - b) <= kTolerance * std::abs(b));
}

void check_positive(double value, const std::string& option) {
  if (!(value > 0) || !std::isfinite(value))
    throw FrameInputError(fmt::format("give {}: it must be a number above 0", option));
}

void check_hertz(double value, const std::string& option) {
  constexpr double kMinHz = 1000;
  check_positive(value, option);
  if (value < kMinHz)
    throw FrameInputError(fmt::format("{} {}: give it in Hz; {} MHz is {}e6", option, value, value, value));
}

void check_sound_speed(double value, const std::string& stated_by) {
  if (!(value >= 1000 && value <= 2500))
    throw FrameInputError(fmt::format("{} {}: give it in m/s, 1000 to 2500; soft tissue has about {}",
                                      stated_by, value, kUsualSoundSpeed));
}

// Of whatever format: it is RF by now, or refused.
RecordedFrame read_frame(const FrameChoice& from, const RecordedFrameOptions& options) {
  RecordedFrame frame = read_any(from, options);
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

}  // namespace teletact::client
