#include "client/watch/view.h"

#include <fmt/format.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <utility>

#include "client/clock/clock.h"
#include "client/link/estimate_stages.h"
#include "client/link/force_terms.h"
#include "client/link/scenes.h"
#include "client/link/tactile_image.h"
#include "client/render/energy_ledger.h"
#include "client/servo/states.h"

namespace teletact::client {
namespace {

using nlohmann::json;

std::size_t index_of(Channel channel) {
  return static_cast<std::size_t>(channel);
}

std::int64_t ns(double seconds) {
  return static_cast<std::int64_t>(seconds * 1e9);
}

json numbers(const google::protobuf::RepeatedField<double>& values) {
  return json(std::vector<double>(values.begin(), values.end()));
}

json json_of(const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.always_print_primitive_fields = options.preserve_proto_field_names = true;
  std::string text;
  if (!google::protobuf::util::MessageToJsonString(message, &text, options).ok()) return json::object();
  return json::parse(text, nullptr, false);
}

}  // namespace

void View::on_change(std::function<void()> changed) {
  const std::lock_guard lock(calling_);
  changed_ = std::move(changed);
}

void View::notify() {
  const std::lock_guard lock(calling_);
  changed_();
}

void View::put(Channel channel, const Slot& slot) {
  slot_[index_of(channel)] = std::make_shared<const std::string>(slot.bytes(channel));
  ++version_[index_of(channel)];
}

v1::RecordHeader View::header() const {
  const std::lock_guard lock(mutex_);
  return header_;
}

std::string View::session_id() const {
  const std::lock_guard lock(mutex_);
  return opened_.is_object() ? opened_.value("session_id", "") : "";
}

void View::restart() {
  const std::lock_guard lock(mutex_);
  trace_.clear();
  lines_.clear();
  windows_.clear();
  figures_ = answer_ = opened_ = json();
  budget_.reset();
  status_ns_ = 0;
  ++era_;
  put(Channel::kTactile, Slot());
  put(Channel::kSurface, Slot());
  put_windows();
}

void View::take(const v1::RecordEntry& entry) {
  {
    const std::lock_guard lock(mutex_);
    switch (entry.kind_case()) {
      case v1::RecordEntry::kHeader:
        if (entry.header().kind() == "touch") header_ = entry.header();
        if (entry.header().kind() == "acquire") {  // counts its calls from the beginning
          windows_.clear();
          put_windows();
        }
        break;
      case v1::RecordEntry::kServo:
        take_tick(entry);
        break;
      case v1::RecordEntry::kTouchRequest:
        if (entry.touch_request().has_open()) opened_ = json_of(entry.touch_request().open());
        break;
      case v1::RecordEntry::kTouchResponse:
        if (entry.touch_response().has_answer()) take_answer(entry.touch_response().answer());
        break;
      case v1::RecordEntry::kEstimateRequest:
      case v1::RecordEntry::kEstimateResponse:
        take_estimate(entry);
        break;
      case v1::RecordEntry::kWindow:
        take_window(entry);
        break;
      case v1::RecordEntry::kFigures:
        figures_ = json_of(entry.figures());
        put_status(entry.monotonic_ns(), true);
        break;
      case v1::RecordEntry::kLog:
        lines_.push_back({{"t_s", seconds(entry.monotonic_ns())},
                          {"warning", entry.log().warning()},
                          {"text", entry.log().text()}});
        if (lines_.size() > kLines) lines_.pop_front();
        put_status(entry.monotonic_ns(), true);
        break;
      default:
        return;
    }
  }
  notify();
}

void View::take_tick(const v1::RecordEntry& entry) {
  if (trace_.add(entry.monotonic_ns(), entry.servo(), budget_)) ++version_[index_of(Channel::kTrace)];
  put_status(entry.monotonic_ns(), false);
}

void View::complete_row() {
  {
    const std::lock_guard lock(mutex_);
    if (!trace_.complete()) return;
    ++version_[index_of(Channel::kTrace)];
  }
  notify();
}

void View::take_answer(const v1::TouchAnswer& answer) {
  budget_.reset();
  if (answer.has_budget()) budget_ = answer.budget();
  std::string path = v1::SolvePath_Name(answer.path()), status = v1::TouchStatus_Name(answer.status());
  answer_ = {{"path", path.substr(std::min(path.size(), sizeof("SOLVE_PATH_") - 1))},
             {"status", status.substr(std::min(status.size(), sizeof("TOUCH_STATUS_") - 1))},
             {"warning", answer.warning()},
             {"version", answer.model_version()},
             {"window", answer.window_id()},
             {"largest_strain", answer.largest_strain()},
             {"compute_s", seconds(answer.compute_ns())},
             {"flags", std::vector<std::string>(answer.window_flags().begin(), answer.window_flags().end())}};
  if (answer.has_budget()) {
    answer_["half_width"] = answer.budget().half_width();
    ForceTerms terms;
    add_terms(answer.budget(), terms);
    if (const auto largest = largest_term(terms))
      answer_["largest_term"] =
          fmt::format("{}, without which it would be {:.0f} % of the force narrower: {}", largest->what,
                      100 * largest->by, largest->remedy);
  }
  if (!answer.has_tactile()) return;
  const auto image = tactile_from(answer.tactile());
  if (!image) return;
  Slot slot({{"pitch_m", image->pitch_m},
             {"x_m", image->begin_x_m},
             {"z_m", image->begin_z_m},
             {"force_n", image->force_n}});
  slot.add("pressure_pa", {image->along_z, image->along_x}, image->pressure_pa);
  if (!image->beyond_pa.empty()) slot.add("beyond_pa", {image->along_z, image->along_x}, image->beyond_pa);
  put(Channel::kTactile, slot);
}

void View::put_status(std::int64_t time_ns, bool at_once) {
  if (!at_once && time_ns < status_ns_ + ns(kStatusS) && time_ns >= status_ns_) return;
  status_ns_ = time_ns;
  json status = told_;
  status["t_s"] = seconds(time_ns);
  status["scene"] = header_.scene_id();
  status["service"] = header_.service();
  status["answer"] = answer_;
  status["figures"] = figures_;
  status["open"] = opened_;
  status["log"] = lines_;
  json& reasons = status["reasons"] = json::array();
  for (std::uint32_t n = 0; n <= static_cast<std::uint32_t>(StateReason::kFrozen); ++n)
    reasons.push_back(describe(static_cast<StateReason>(n)));
  json& claims = status["claims"] = json::array();
  for (std::uint32_t n = 0; n <= static_cast<std::uint32_t>(EnergyClaim::kBorder); ++n)
    claims.push_back(name(static_cast<EnergyClaim>(n)));
  put(Channel::kStatus, Slot(std::move(status)));
}

void View::take_estimate(const v1::RecordEntry& entry) {
  json& window = windows_[entry.call()];
  if (entry.has_estimate_request()) {
    const v1::Acquisition& acquisition = entry.estimate_request().acquisition();
    if (!acquisition.has_publish()) return;
    // One after the other: what is not there by now does not come any more.
    for (auto& [call, earlier] : windows_)
      if (call < entry.call() && earlier.value("stage", "") != "published")
        earlier["stage"] = "not published";
    window["origin_m"] = numbers(acquisition.publish().window().origin_m());
    window["width_m"] = acquisition.line_count() * acquisition.line_pitch_m();
    window["stage"] = "sent";
    window["sent_s"] = seconds(entry.monotonic_ns());
  } else if (entry.estimate_response().has_progress()) {
    const v1::EstimateProgress& progress = entry.estimate_response().progress();
    window["stage"] = stage_name(progress.stage());
    window["stages"].push_back({window["stage"], progress.elapsed_s()});
  } else if (entry.estimate_response().has_summary()) {
    const v1::EstimateSummary& summary = entry.estimate_response().summary();
    window["stage"] = "published";
    window["service_s"] = summary.received_to_published_s();
    window["background_pa"] = summary.background_modulus_pa();
    window["quality"] = summary.quality();
    window["version"] = summary.scene_version();
    window["warnings"] = std::vector<std::string>(summary.warnings().begin(), summary.warnings().end());
  }
  put_windows();
}

void View::take_window(const v1::RecordEntry& entry) {
  json& window = windows_[entry.call()];
  const v1::WindowTiming& timing = entry.window();
  window["origin_m"] = numbers(timing.window().origin_m());
  window["stage"] = "published";
  window["asked_to_published_s"] = seconds_between(timing.asked_ns(), timing.published_ns());
  put_windows();
}

void View::put_windows() {
  while (windows_.size() > kWindows) windows_.erase(windows_.begin());
  json windows = json::array();
  for (const auto& [call, window] : windows_) {
    windows.push_back(window);
    windows.back()["call"] = call;
  }
  put(Channel::kWindows, Slot(json{{"windows", windows}}));
}

void View::put_scene(const v1::Scene& scene) {
  json out{{"scene_id", scene.scene_id()},
           {"version", scene.version()},
           {"kind", kind_of(scene)},
           {"size_m", numbers(scene.geometry().size_m())}};
  for (const v1::Window& window : scene.windows())
    out["windows"].push_back({{"id", window.window_id()},
                              {"version", window.version()},
                              {"begin_x_m", window.covers().begin_x_m()},
                              {"end_x_m", window.covers().end_x_m()},
                              {"touchable", window.touchable()},
                              {"given", !window.has_evidence()},
                              {"plan", window.plan()},
                              {"quality", window.evidence().quality()},
                              {"log_std", window.evidence().youngs_modulus_log_std()},
                              {"warnings", std::vector<std::string>(window.evidence().warnings().begin(),
                                                                    window.evidence().warnings().end())}});
  put(Channel::kScene, Slot(std::move(out)));
  maps_.take(scene);
}

void View::put_maps() {
  if (maps_.cells_changed()) put(Channel::kMap, maps_.cells());
  if (maps_.images_changed()) put(Channel::kBMode, maps_.images());
}

void View::put_surface(const v1::DeformedSurface& surface) {
  const std::size_t nx = static_cast<std::size_t>(surface.x_m_size()),
                    nz = static_cast<std::size_t>(surface.z_m_size());
  const std::string& data = surface.displacement_m().data();
  if (surface.displacement_m().dtype() != v1::DATA_TYPE_FLOAT32 || data.size() != nx * nz * sizeof(float))
    return;
  std::vector<float> displacement_m(nx * nz);
  std::memcpy(displacement_m.data(), data.data(), data.size());
  Slot slot(json{{"depth_m", surface.depth_m()}});
  slot.add("x_m", {nx}, std::vector<double>(surface.x_m().begin(), surface.x_m().end()));
  slot.add("z_m", {nz}, std::vector<double>(surface.z_m().begin(), surface.z_m().end()));
  slot.add("displacement_m", {nz, nx}, displacement_m);
  put(Channel::kSurface, slot);
}

void View::take_scene(const v1::Scene& scene) {
  {
    const std::lock_guard lock(mutex_);
    put_scene(scene);
    put_maps();
  }
  notify();
}

void View::take_observed(const v1::Observation& seen) {
  if (!seen.has_scene() && seen.maps().empty() && !seen.has_surface()) return;
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(away_, false)) maps_.clear();
    if (seen.has_scene()) put_scene(seen.scene());
    for (const v1::ObservedMap& part : seen.maps()) maps_.take(part);
    put_maps();
    if (seen.has_surface()) put_surface(seen.surface());
  }
  notify();
}

void View::look_away(bool elsewhere) {
  {
    const std::lock_guard lock(mutex_);
    away_ = true;
    if (elsewhere) {
      maps_.clear();
      put_maps();
      put(Channel::kScene, Slot());
    }
    put(Channel::kSurface, Slot());
  }
  notify();
}

void View::tell(const std::string& name, json value) {
  {
    const std::lock_guard lock(mutex_);
    if (told_.contains(name) && told_[name] == value) return;
    told_[name] = std::move(value);
    put_status(status_ns_, true);
  }
  notify();
}

void View::tell_timeline(json timeline) {
  {
    const std::lock_guard lock(mutex_);
    put(Channel::kTimeline, Slot(std::move(timeline)));
  }
  notify();
}

std::vector<std::shared_ptr<const std::string>> View::news(Seen& seen) {
  const std::lock_guard lock(mutex_);
  std::vector<std::shared_ptr<const std::string>> out;
  const bool other = seen.era != era_;
  for (std::size_t channel = 0; channel < kChannels; ++channel) {
    const bool trace = channel == index_of(Channel::kTrace);
    if (seen.version[channel] == version_[channel] && !(trace && other)) continue;
    seen.version[channel] = version_[channel];
    if (!trace) {
      if (slot_[channel]) out.push_back(slot_[channel]);
      continue;
    }
    Slot slot = trace_.slot(other ? 0 : seen.row);
    slot.set("era", era_);
    slot.set("mono_s", seconds(monotonic_ns()));
    slot.set("wall_s",
             std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count());
    out.push_back(std::make_shared<const std::string>(slot.bytes(Channel::kTrace)));
    seen.row = trace_.rows();
    seen.era = era_;
  }
  return out;
}

}  // namespace teletact::client
