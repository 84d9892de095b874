#include "service/rpc/acquisition.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "service/device/look.h"
#include "service/imaging/maps.h"
#include "service/rpc/convert.h"
#include "service/scene/errors.h"

namespace teletact::service {

std::size_t EstimateRequest::frame_bytes() const {
  return sample_count * line_count * bytes_per_item(dtype);
}

EstimateSize EstimateRequest::size() const {
  const ElastographyOptions usual;
  return {sample_count,
          line_count,
          max_strain,
          window_width_m(),
          tissue.depth_m,
          modulus.kind.value_or(usual.modulus),
          modulus.time_limit_s.value_or(usual.modulus_time_limit_s),
          scene != nullptr};
}

namespace {

// Of the force sensor and the contact area, where they are not stated.
constexpr double kUsualForceDeviation = 0.03, kUsualAreaDeviation = 0.05;

template <class T>
void require_between(const char* field, T value, T least, T most, const char* remedy) {
  if (value >= least && value <= most) return;  // false for NaN
  throw std::invalid_argument(
      fmt::format("acquisition.{}: {} is not within [{}, {}]; {}", field, value, least, most, remedy));
}

void check_frame_size(const v1::Acquisition& in, const Limits& limits) {
  const std::size_t item = bytes_per_item(in.dtype());
  if (in.dtype() != v1::DATA_TYPE_INT16 && in.dtype() != v1::DATA_TYPE_FLOAT32)
    throw std::invalid_argument("acquisition.dtype: must be INT16 or FLOAT32");
  const auto bytes = static_cast<unsigned __int128>(in.sample_count()) * in.line_count() * item;
  if (bytes > limits.most_frame_bytes)
    throw Error(
        ErrorKind::kExhausted,
        fmt::format(
            "acquisition.sample_count, acquisition.line_count: {} x {} samples are more than the {} bytes "
            "a frame may have; crop the frame",
            in.sample_count(), in.line_count(), limits.most_frame_bytes));
  require_between<std::uint64_t>("sample_count", in.sample_count(), limits.least_samples, limits.most_samples,
                                 "give the samples of one A-line");
  require_between<std::uint64_t>("line_count", in.line_count(), limits.least_lines, limits.most_lines,
                                 "give the number of A-lines");
}

AcquisitionGeometry acquisition_geometry(const v1::Acquisition& in, const Limits& limits) {
  AcquisitionGeometry g;
  g.center_frequency_hz = in.center_frequency_hz();
  g.sampling_frequency_hz = in.sampling_frequency_hz();
  g.sound_speed_m_s = in.sound_speed_m_s();
  g.line_pitch_m = in.line_pitch_m();
  g.first_sample_depth_m = in.first_sample_depth_m();
  require_between("center_frequency_hz", g.center_frequency_hz, limits.least_center_frequency_hz,
                  limits.most_center_frequency_hz, "give the transducer's centre frequency");
  if (!(g.sampling_frequency_hz > 2 * g.center_frequency_hz) || !std::isfinite(g.sampling_frequency_hz))
    throw std::invalid_argument(fmt::format(
        "acquisition.sampling_frequency_hz: {} is not > 2 x center_frequency_hz; give the digitiser's rate",
        g.sampling_frequency_hz));
  require_between("sound_speed_m_s", g.sound_speed_m_s, limits.least_sound_speed_m_s,
                  limits.most_sound_speed_m_s, "soft tissue is about 1540");
  require_between("line_pitch_m", g.line_pitch_m, limits.least_line_pitch_m, limits.most_line_pitch_m,
                  "give the distance of two A-lines in metres");
  require_between("first_sample_depth_m", g.first_sample_depth_m, 0.0, limits.most_first_sample_depth_m,
                  "give the depth of the first sample in metres");
  switch (in.displacement_frame()) {
    case v1::DISPLACEMENT_FRAME_LAB:
      g.frame = DisplacementFrame::kLab;
      break;
    case v1::DISPLACEMENT_FRAME_PROBE:
      g.frame = DisplacementFrame::kProbe;
      break;
    default:
      throw std::invalid_argument(
          "acquisition.displacement_frame: must be stated; LAB where the far side rests, PROBE where the "
          "probe face rests");
  }
  return g;
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

TissueExtent tissue_of(const v1::Acquisition& in, const EstimateRequest& request, const Limits& limits) {
  TissueExtent tissue;
  const AcquisitionGeometry& g = request.geometry;
  const double frame_end_m =
      g.first_sample_depth_m + g.sample_pitch_m() * static_cast<double>(request.sample_count);
  tissue.depth_m = request.scene ? request.scene->geometry().depth_m : frame_end_m;
  if (in.tissue_depth_m() != 0) tissue.depth_m = in.tissue_depth_m();
  tissue.poisson_ratio = request.scene ? request.scene->geometry().poisson_ratio : 0.49;
  if (in.poisson_ratio() != 0) tissue.poisson_ratio = in.poisson_ratio();
  require_between("tissue_depth_m", tissue.depth_m, limits.least_tissue_depth_m, limits.most_tissue_depth_m,
                  "give the depth of the fixed far side in metres");
  require_between("poisson_ratio", tissue.poisson_ratio, 0.0, TissueExtent::kLargestPoissonRatio,
                  "soft tissue is about 0.49; an estimate's modulus would hang on nu alone nearer to 1/2");
  const double width_m = request.window_width_m();
  if (request.scene) {
    const SceneGeometry& stated = request.scene->geometry();
    check_agrees("tissue_depth_m", in.tissue_depth_m(), stated.depth_m, *request.scene);
    check_agrees("poisson_ratio", in.poisson_ratio(), stated.poisson_ratio, *request.scene);
    check_agrees("tissue_width_m", in.tissue_width_m(), stated.width_m, *request.scene);
    // A window may stick out of the scene by Scene::kOverhangM; the probe touches what is there.
    tissue.width_m = std::max(request.scene->geometry().width_m, width_m);
    tissue.window_x_m = std::clamp(request.window_x_m, 0.0, tissue.width_m - width_m);
  } else {
    tissue.width_m = in.tissue_width_m() != 0 ? in.tissue_width_m() : width_m;
    require_between("tissue_width_m", tissue.width_m, width_m, limits.most_tissue_width_m,
                    "the tissue is at least as wide as the window");
    tissue.window_x_m = (tissue.width_m - width_m) / 2;
  }
  return tissue;
}

// Over the value itself; `stated` = 0: `usual`.
double relative_deviation(const char* field, double stated, double value, double usual) {
  if (!(stated >= 0 && stated < value))
    throw std::invalid_argument(fmt::format(
        "acquisition.probe_force.{}: {} is not within [0, {}), the value that it belongs to; give its "
        "standard deviation, or leave it out for {:.0f} %",
        field, stated, value, 100 * usual));
  return stated == 0 ? usual : stated / value;
}

void read_force(const v1::Acquisition& in, const Limits& limits, EstimateRequest& request) {
  if (!in.has_probe_force()) return;
  const double window_width_m = request.window_width_m();
  const ProbeForce force{in.probe_force().force_n(), in.probe_force().contact_area_m2()};
  require_between("probe_force.force_n", force.force_n, limits.least_probe_force_n, limits.most_probe_force_n,
                  "give the sensor's change from pre to post, > 0 in compression");
  // Of 0.1 mm to 0.5 m across the image plane: cm^2 or mm^2 given for m^2 lie outside.
  require_between("probe_force.contact_area_m2", force.contact_area_m2,
                  limits.least_probe_elevation_m * window_width_m,
                  limits.most_probe_elevation_m * window_width_m,
                  "give the area of the probe's face that touches, the window's width times the face's "
                  "elevation, in m^2 (1 cm^2 is 1e-4)");
  request.force = force;
  request.force_relative_deviation =
      relative_deviation("force_std_n", in.probe_force().force_std_n(), force.force_n, kUsualForceDeviation);
  request.area_relative_deviation =
      relative_deviation("contact_area_std_m2", in.probe_force().contact_area_std_m2(), force.contact_area_m2,
                         kUsualAreaDeviation);
}

// Each at most once: the answer is as large as what is asked for.
std::vector<std::string> maps_from(const v1::Acquisition& in) {
  std::vector<std::string> maps;
  std::vector<std::string> known;
  for (const EstimateMap& map : estimate_maps()) known.push_back(map.name);
  for (const std::string& map : in.maps()) {
    if (!find_map(map))
      throw std::invalid_argument(
          fmt::format("acquisition.maps: \"{}\" is unknown; one of {}", shown(map), fmt::join(known, ", ")));
    if (std::find(maps.begin(), maps.end(), map) != maps.end())
      throw std::invalid_argument(fmt::format("acquisition.maps: \"{}\" twice; ask for it once", map));
    maps.push_back(map);
  }
  return maps.empty() ? known : maps;
}

}  // namespace

namespace {

ModulusChoice modulus_choice(const v1::Acquisition& in, const Limits& limits) {
  ModulusChoice choice;
  if (in.modulus_time_limit_s() != 0) {
    require_between("modulus_time_limit_s", in.modulus_time_limit_s(), limits.least_modulus_time_s,
                    limits.most_modulus_time_s, "leave it out for 0.35");
    choice.time_limit_s = in.modulus_time_limit_s();
  }
  switch (in.modulus_method()) {
    case v1::MODULUS_METHOD_UNSPECIFIED:
      break;
    case v1::MODULUS_METHOD_REFERENCE_STRESS:
      choice.kind = ModulusKind::kReferenceStress;
      break;
    case v1::MODULUS_METHOD_DIRECT:
      choice.kind = ModulusKind::kDirect;
      break;
    case v1::MODULUS_METHOD_ITERATIVE:
      choice.kind = ModulusKind::kIterative;
      break;
    default:
      throw std::invalid_argument(
          "acquisition.modulus_method: unknown; leave it out or use REFERENCE_STRESS, DIRECT or ITERATIVE");
  }
  return choice;
}

Plane plane_of(const v1::Acquisition& in) {
  switch (in.plane()) {
    case v1::PLANE_CONDITION_UNSPECIFIED:
    case v1::PLANE_CONDITION_STRAIN:
      return Plane::kStrain;
    case v1::PLANE_CONDITION_STRESS:
      return Plane::kStress;
    default:
      throw std::invalid_argument("acquisition.plane: unknown; leave it out or use STRAIN or STRESS");
  }
}

// Along x alone a window of a plane scene may lie anywhere.
double window_x_from(const v1::SlicePose& in) {
  const auto lies_along = [](const char* field, const auto& stated, const std::array<double, 3>& axis) {
    if (stated.empty() || vector_from(field, stated, false) == axis) return;
    throw std::invalid_argument(
        fmt::format("{}: a plane scene's windows lie along its own axes; leave it out", field));
  };
  lies_along("publish.window.lateral", in.lateral(), {1, 0, 0});
  lies_along("publish.window.axial", in.axial(), {0, 1, 0});
  constexpr const char* kOrigin = "publish.window.origin_m";
  const auto origin_m = vector_from(kOrigin, in.origin_m(), false);
  for (const std::size_t axis : {1U, 2U})
    if (origin_m[axis] != 0)
      throw std::invalid_argument(
          fmt::format("{}[{}]: {}; a plane scene's windows begin at its surface and lie in its plane: give "
                      "[x, 0, 0]",
                      kOrigin, axis, origin_m[axis]));
  return origin_m[0];
}

}  // namespace

EstimateRequest request_from(const v1::Acquisition& in, const Scenes& scenes, const Limits& limits) {
  check_frame_size(in, limits);
  EstimateRequest request;
  request.sample_count = in.sample_count();
  request.line_count = in.line_count();
  request.dtype = in.dtype();
  request.geometry = acquisition_geometry(in, limits);
  require_between("line_pitch_m x line_count", request.window_width_m(), 0.0, limits.most_window_width_m,
                  "no probe is wider; give the distance of two A-lines in metres");
  read_force(in, limits, request);
  request.modulus = modulus_choice(in, limits);
  if (in.max_strain() != 0) request.max_strain = in.max_strain();
  require_between("max_strain", request.max_strain, limits.least_max_strain, limits.most_max_strain,
                  "leave it out for 0.05");
  DisplacementOptions search;
  search.max_strain = request.max_strain;
  DisplacementEstimator::require_fits({request.sample_count, request.line_count, {}}, request.geometry,
                                      search);
  request.maps = maps_from(in);
  request.finish_within_s = in.finish_within_s();
  require_between("finish_within_s", request.finish_within_s, 0.0, limits.most_finish_within_s,
                  "give seconds after the last byte, or leave it out");
  if (in.has_publish()) {
    request.scene = scenes.find(in.publish().scene_id());
    request.window_x_m = window_x_from(in.publish().window());
    request.scene->check_window(request.window_x_m, request.window_x_m + request.window_width_m());
    if (!request.force)
      throw std::invalid_argument(
          "acquisition.probe_force: missing; without it the modulus is relative and nothing can be "
          "published");
  }
  request.tissue = tissue_of(in, request, limits);
  request.tissue.plane = plane_of(in);
  if (request.scene && request.tissue.plane == Plane::kStress)
    throw std::invalid_argument(
        "acquisition.plane: a scene is touched in plane strain; leave STRESS out, or publish out");
  return request;
}

std::vector<std::string> warnings_of(const Estimate& e) {
  std::vector<std::string> warnings = e.input_warnings;
  for (const ModulusWarning& warning : e.modulus_warnings)
    warnings.push_back(fmt::format("{}: {}", name_of(warning.flag), warning.text));
  return warnings;
}

WindowEstimate window_of(const EstimateRequest& request, const Estimate& e,
                         std::chrono::steady_clock::time_point received) {
  WindowEstimate window{request.window_x_m,     request.window_width_m(), e.grid, e.youngs_modulus, e.valid,
                        e.modulus_log_deviation};
  WindowEvidence& evidence = window.evidence;
  evidence.warnings = warnings_of(e);
  evidence.force_relative_deviation = request.force_relative_deviation;
  evidence.area_relative_deviation = request.area_relative_deviation;
  evidence.background_modulus_pa = e.background_modulus;
  evidence.quality = e.quality;
  evidence.taken_in = received;
  return window;
}

FrameUpload::FrameUpload(const EstimateRequest& request, std::size_t most_chunk_bytes)
    : samples_(request.sample_count),
      lines_(request.line_count),
      frame_bytes_(request.frame_bytes()),
      most_chunk_bytes_(most_chunk_bytes),
      dtype_(request.dtype) {}

void FrameUpload::add(const v1::FrameChunk& chunk) {
  if (chunk.frame() != v1::FRAME_KIND_PRE && chunk.frame() != v1::FRAME_KIND_POST)
    throw std::invalid_argument("chunk.frame: must be PRE or POST");
  std::string& frame = chunk.frame() == v1::FRAME_KIND_PRE ? pre_ : post_;
  if (chunk.data().size() > most_chunk_bytes_)
    throw std::invalid_argument(fmt::format("chunk.data: {} bytes, at most {} per chunk; send smaller ones",
                                            chunk.data().size(), most_chunk_bytes_));
  if (chunk.offset_bytes() != frame.size())
    throw std::invalid_argument(
        fmt::format("chunk.offset_bytes: {}, but {} bytes of the frame have come; send the chunks "
                    "in order",
                    chunk.offset_bytes(), frame.size()));
  if (frame.size() + chunk.data().size() > frame_bytes_)
    throw std::invalid_argument(
        fmt::format("chunk.data: more than the {} bytes that sample_count x line_count declare; "
                    "both frames must be of that size",
                    frame_bytes_));
  frame += chunk.data();
}

void FrameUpload::require_whole() const {
  require_whole("pre", pre_);
  require_whole("post", post_);
}

void FrameUpload::require_whole(const char* name, const std::string& bytes) const {
  if (bytes.size() != frame_bytes_)
    throw std::invalid_argument(
        fmt::format("chunk.data: the {} frame has {} of {} bytes; send the rest before closing", name,
                    bytes.size(), frame_bytes_));
}

std::pair<RfFrame, RfFrame> FrameUpload::finish() {
  RfFrame pre = frame("pre", pre_);
  return {std::move(pre), frame("post", post_)};
}

RfFrame FrameUpload::frame(const char* name, std::string& bytes) const {
  require_whole(name, bytes);
  RfFrame frame{samples_, lines_, {}};
  frame.samples.reserve(samples_ * lines_);
  std::vector<std::int16_t> values(samples_);
  std::vector<float> line(samples_);
  // Beyond, sums of squares over a window leave the range of float and the correlation means nothing.
  constexpr float kLargestSample = 1e15F;
  for (std::size_t l = 0; l < lines_; ++l) {
    look();
    const std::size_t each = samples_ * bytes_per_item(dtype_);
    if (dtype_ == v1::DATA_TYPE_FLOAT32) {
      std::memcpy(line.data(), bytes.data() + l * each, each);
    } else {
      std::memcpy(values.data(), bytes.data() + l * each, each);
      std::copy(values.begin(), values.end(), line.begin());
    }
    const auto bad =
        std::find_if(line.begin(), line.end(), [](float s) { return !(std::abs(s) <= kLargestSample); });
    if (bad != line.end())
      throw std::invalid_argument(fmt::format(
          "chunk.data: sample {} of A-line {} of the {} frame is {}, no finite number of at most {} "
          "in size; replace or crop it",
          bad - line.begin(), l, name, *bad, kLargestSample));
    frame.samples.insert(frame.samples.end(), line.begin(), line.end());
  }
  bytes = {};  // the copy is no longer needed
  return frame;
}

}  // namespace teletact::service
