#include "client/acquire/session.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <utility>

#include "client/link/channel.h"

namespace teletact::client {
namespace {

constexpr double kLookEveryS = 0.005;  // how often an idle arm looks at the finger
constexpr double kNapS = 0.05;         // longest sleep between looks at `stop`

PlannerOptions planner_for(const FrameSource& source, PlannerOptions options) {
  options.window_count = source.window_count();
  options.window_width_m = source.window_width_m();
  return options;
}

// Where the first slice's elements begin.
double begin_m(const SlicePlaces& places) {
  return places.first_z_m - places.pitch_m / 2;
}

bool pair_is_useless(grpc::StatusCode code) {
  return code == grpc::StatusCode::FAILED_PRECONDITION;
}

// A correction that is refused leaves the slice as it is; without a scene, or a service, nothing goes on.
bool leaves_the_slice(grpc::StatusCode code) {
  using enum grpc::StatusCode;
  return code != NOT_FOUND && code != ABORTED && code != UNAVAILABLE && code != CANCELLED &&
         code != PERMISSION_DENIED && code != UNAUTHENTICATED;
}

// Why a wish makes no sense; empty: it does.
std::string problem_of(const v1::SliceWish& wish, const std::optional<SliceOptions>& slices) {
  const auto asked = [&] { return fmt::format("a slice is asked for at z = {:.1f} mm", wish.z_m() * 1e3); };
  if (!slices) return asked() + ", in a plane scene";
  const SlicePlaces& places = slices->grid.places;
  const double from_m = begin_m(places), to_m = from_m + places.pitch_m * static_cast<double>(places.count);
  constexpr double kRoundingM = 1e-9;
  if (!(wish.z_m() > from_m - kRoundingM && wish.z_m() < to_m + kRoundingM))
    return fmt::format("{}, but slices are taken from {:.1f} to {:.1f} mm", asked(), from_m * 1e3,
                       to_m * 1e3);
  if (!(wish.half_width() >= 0 && std::isfinite(wish.half_width())))
    return fmt::format("{}, where the force may be off by {} of it", asked(), wish.half_width());
  return "";
}

}  // namespace

AcquireSession::AcquireSession(const std::string& address, const Credentials& credentials,
                               FrameSource& source, const AcquireOptions& options, AcquireObserver observer)
    : address_(address),
      credentials_(credentials),
      source_(source),
      options_(options),
      observer_(std::move(observer)),
      planner_(planner_for(source, options.planner), options.start_x_m, options.start_direction),
      epoch_ns_(monotonic_ns()),
      arm_(options.arm, planner_.window_x_m(planner_.window_at(options.start_x_m)), 0),
      client_(make_channel(address, credentials), options.retry_for_s),
      acquired_s_(source.window_count()),
      passes_(source.window_count(), 0) {
  if (options.slices) {
    scene_.emplace(make_channel(address, credentials), options.scene_id, options.slices->grid,
                   options.retry_for_s);
    corrections_.emplace(source.window_count());
  } else {
    finger_.emplace(address, credentials, options.scene_id);
  }
  uploader_ = std::thread([this] { upload_loop(); });
}

AcquireSession::~AcquireSession() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
    abandon_ = true;
    changed_.notify_all();
  }
  if (uploader_.joinable()) uploader_.join();
}

AcquireResult AcquireSession::run(const std::atomic<bool>& stop) {
  const std::int64_t begin_ns = monotonic_ns();
  bool was_ready = false;
  while (!stop && !finished(begin_ns)) {
    rethrow_failure();
    const FingerMotion motion = finger();
    const auto next = planner_.next(motion, knowledge(), now_s());
    {
      const bool resting = !next && !motion.present;
      const std::lock_guard lock(mutex_);
      if (std::exchange(resting_, resting) != resting) changed_.notify_all();
    }
    if (!was_ready && (options_.slices ? ready() : !next && idle())) {
      was_ready = true;
      if (observer_.ready) observer_.ready();
    }
    const bool wished = next && motion.wished_m && *next == planner_.window_at(*motion.wished_m);
    if (next && has_room()) {
      if (wished && observer_.note)
        observer_.note(
            fmt::format("asked for a slice at z = {:.1f} mm: the force there may be off by {:.0f} %",
                        wish_->z_m() * 1e3, wish_->half_width() * 1e2));
      acquire(*next, stop);
      continue;
    }
    sleep_until(now_s() + kLookEveryS, stop);
  }
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
    if (stop) abandon_ = true;
    changed_.notify_all();
  }
  uploader_.join();
  if (!stop) rethrow_failure();
  for (std::size_t k = 0; k < acquired_s_.size(); ++k) result_.exhausted += source_.frames_left(k) == 0;
  return result_;
}

// One acquisition in real time: the frames are handed over at the post frame's tick and the arm lifts while
// they travel.
void AcquireSession::acquire(std::size_t window, const std::atomic<bool>& stop) {
  Upload upload{{}, window, {}};
  *upload.timing.mutable_window() = pose_of(window);
  upload.timing.set_asked_ns(monotonic_ns());
  const ArmSchedule schedule = arm_.acquire(planner_.window_x_m(window), source_.compression_m(), now_s());
  {
    const std::lock_guard lock(mutex_);
    acquired_s_[window] = schedule.post_frame_s;
    upload.timing.set_pass(passes_[window]++);
  }
  upload.pair = source_.take(window);
  sleep_until(schedule.post_frame_s, stop);
  if (stop) return;
  upload.timing.set_acquired_ns(monotonic_ns());
  upload.timing.set_force_n(upload.pair.acquisition.probe_force().force_n());
  {
    const std::lock_guard lock(mutex_);
    queue_.push_back(std::move(upload));
    changed_.notify_all();
  }
  sleep_until(schedule.lifted_s, stop);
}

v1::SlicePose AcquireSession::pose_of(std::size_t window) const {
  v1::SlicePose pose;
  const double z_m = options_.slices ? options_.slices->grid.places.z_m(window) : 0;
  for (const double origin_m : {options_.slices ? 0 : planner_.window_x_m(window), 0.0, z_m})
    pose.add_origin_m(origin_m);
  return pose;
}

bool AcquireSession::has_room() {
  const std::lock_guard lock(mutex_);
  return options_.slices ? queue_.empty() && !uploading_ && !correcting_ : queue_.size() < kMaxQueuedUploads;
}

void AcquireSession::upload_loop() {
  std::unique_lock lock(mutex_);
  const auto due = [this] { return corrections_ && resting_ ? corrections_->due() : std::nullopt; };
  while (true) {
    changed_.wait(lock, [&] { return closing_ || !queue_.empty() || due(); });
    if (abandon_ || failure_ || (closing_ && queue_.empty())) return;
    std::function<void()> work;
    if (queue_.empty()) {
      correcting_ = true;
      const std::size_t slice = *due();
      work = [this, slice, pair = corrections_->take(slice)]() mutable { correct(slice, std::move(pair)); };
    } else {
      uploading_ = true;
      work = [this, upload = std::move(queue_.front())]() mutable { upload_one(std::move(upload)); };
      queue_.pop_front();
    }
    lock.unlock();
    std::exception_ptr failure;
    try {
      work();
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    uploading_ = correcting_ = false;
    failure_ = failure;
    changed_.notify_all();
  }
}

EstimateOutcome AcquireSession::estimate(const FramePair& pair, std::size_t window) {
  v1::Acquisition acquisition = pair.acquisition;
  acquisition.set_modulus_method(options_.modulus_method);
  acquisition.set_modulus_time_limit_s(options_.modulus_time_limit_s);
  if (options_.slices) {
    acquisition.set_plane(v1::PLANE_CONDITION_SOLID);
    acquisition.set_tissue_depth_m(options_.slices->grid.depth_m);
    acquisition.set_poisson_ratio(options_.slices->grid.poisson_ratio);
    acquisition.set_probe_elevation_m(options_.slices->probe_elevation_m);
    for (const char* map : {"youngs_modulus", "youngs_modulus_log_std", "youngs_modulus_log_modes"})
      acquisition.add_maps(map);
    if (scene_->made()) {
      acquisition.mutable_slice_of()->set_scene_id(options_.scene_id);
      *acquisition.mutable_slice_of()->mutable_window() = pose_of(window);
    }
  } else {
    acquisition.mutable_publish()->set_scene_id(options_.scene_id);
    *acquisition.mutable_publish()->mutable_window() = pose_of(window);
    acquisition.set_plane(options_.plane);
  }
  acquisition.MergeFrom(options_.stated);
  if (options_.all_maps) acquisition.clear_maps();
  EstimateCallbacks callbacks;
  callbacks.request = [this](const v1::EstimateRequest& request) {
    if (request.has_acquisition()) ++calls_;  // a repeated call is a call of its own
    if (observer_.request) observer_.request(calls_, request);
  };
  callbacks.waiting = observer_.note;
  if (observer_.response)
    callbacks.response = [this](const v1::EstimateResponse& response) {
      observer_.response(calls_, response);
    };
  return client_.estimate(acquisition, pair.pre, pair.post, callbacks, abandon_);
}

bool AcquireSession::done(const std::function<void()>& work, bool (*may_fail)(grpc::StatusCode)) const {
  try {
    work();
  } catch (const ServiceError& error) {
    if (!may_fail(error.code)) throw;
    if (observer_.note) observer_.note(error.what());
    return false;
  }
  return true;
}

void AcquireSession::upload_one(Upload upload) {
  const auto neighbours = [&] {
    const std::lock_guard lock(mutex_);
    return corrections_ ? corrections_->neighbours(upload.window) : 0;
  }();
  if (done([&] { publish(upload, estimate(upload.pair, upload.window)); }, pair_is_useless)) {
    const std::lock_guard lock(mutex_);
    if (corrections_) corrections_->published(upload.window, std::move(upload.pair), neighbours);
    return;
  }
  // That a pair cannot be tracked, or was hardly pressed, is a fact of ultrasound: the window stays unknown
  // and is acquired again.
  const std::lock_guard lock(mutex_);
  acquired_s_[upload.window].reset();
  ++result_.refused;
}

void AcquireSession::correct(std::size_t slice, FramePair pair) {
  const auto neighbours = [&] {
    const std::lock_guard lock(mutex_);
    return corrections_->neighbours(slice);
  }();
  const auto again = [&] {
    const EstimateOutcome outcome = estimate(pair, slice);
    const PublishedSlice published = scene_->publish(slice, outcome.maps, abandon_);
    if (observer_.corrected) observer_.corrected(slice, published.version, outcome.summary);
    say_warnings(published);
  };
  done(again, leaves_the_slice);
  const std::lock_guard lock(mutex_);
  corrections_->published(slice, std::move(pair), neighbours);
}

void AcquireSession::publish(Upload& upload, const EstimateOutcome& outcome) {
  PublishedSlice slice;
  if (scene_) slice = scene_->publish(upload.window, outcome.maps, abandon_);
  upload.timing.set_last_byte_ns(outcome.last_byte_ns);
  upload.timing.set_published_ns(scene_ ? monotonic_ns() : outcome.published_ns);
  if (observer_.window) observer_.window(calls_, upload.timing, outcome.summary);
  if (scene_ && observer_.slice) observer_.slice(upload.window, slice.version);
  say_warnings(slice);
  const std::lock_guard lock(mutex_);
  scene_made_ = true;
  result_.windows.push_back(upload.timing);
}

void AcquireSession::say_warnings(const PublishedSlice& slice) const {
  if (observer_.note)
    for (const std::string& warning : slice.warnings) observer_.note("warning: " + warning);
}

// As the planner counts: from the first window's left border, or half of a pitch before the first slice.
FingerMotion AcquireSession::finger() {
  if (!finger_) {
    const std::lock_guard lock(mutex_);
    if (!scene_made_) return {};
  }
  if (!finger_) finger_.emplace(address_, credentials_, options_.scene_id, 2);
  FingerMotion motion = finger_->motion(monotonic_ns());
  motion.wished_m = wished_m();
  if (options_.slices) motion.x_m -= begin_m(options_.slices->grid.places);
  return motion;
}

// The same of a slice that is asked for.
std::optional<double> AcquireSession::wished_m() {
  wish_ = finger_->wish();
  const std::string problem = wish_ ? problem_of(*wish_, options_.slices) : "";
  if (!problem.empty()) {
    if (!ignored_ && observer_.note) observer_.note("ignored: " + problem);
    ignored_ = true;
    wish_.reset();
  }
  if (!wish_) return std::nullopt;
  return wish_->z_m() - begin_m(options_.slices->grid.places);
}

// Those ahead of a finger at the start, or all that can be had.
bool AcquireSession::ready() {
  const bool all = all_slices();
  const std::lock_guard lock(mutex_);
  return scene_made_ && (all || result_.windows.size() > options_.planner.lookahead);
}

bool AcquireSession::all_slices() {
  if (!idle()) return false;
  const std::lock_guard lock(mutex_);
  for (std::size_t k = 0; k < acquired_s_.size(); ++k)
    if (!acquired_s_[k] && source_.frames_left(k) > 0) return false;
  return true;
}

bool AcquireSession::all_corrected() {
  const std::lock_guard lock(mutex_);
  return !correcting_ && !(corrections_ && corrections_->due());
}

bool AcquireSession::finished(std::int64_t begin_ns) {
  const std::string failure = finger_ ? finger_->failure() : "";
  if (!failure.empty()) throw ServiceError(grpc::StatusCode::ABORTED, failure);
  const std::int64_t now = monotonic_ns();
  if (options_.duration_s > 0 && seconds(now - begin_ns) >= options_.duration_s) return true;
  if (options_.slices && !options_.until_finger_leaves && options_.duration_s == 0)
    return all_slices() && all_corrected();
  const auto gone = finger_ ? finger_->gone_since_ns() : std::nullopt;
  return options_.until_finger_leaves && gone && seconds(now - *gone) >= options_.finger_gone_s;
}

bool AcquireSession::idle() {
  const std::lock_guard lock(mutex_);
  return queue_.empty() && !uploading_;
}

void AcquireSession::rethrow_failure() {
  const std::lock_guard lock(mutex_);
  if (failure_) std::rethrow_exception(failure_);
}

std::vector<WindowKnowledge> AcquireSession::knowledge() {
  const std::lock_guard lock(mutex_);
  std::vector<WindowKnowledge> windows(acquired_s_.size());
  for (std::size_t k = 0; k < windows.size(); ++k) windows[k] = {acquired_s_[k], source_.frames_left(k)};
  return windows;
}

void AcquireSession::sleep_until(double time_s, const std::atomic<bool>& stop) const {
  for (double left = time_s - now_s(); left > 0 && !stop; left = time_s - now_s())
    std::this_thread::sleep_for(std::chrono::duration<double>(std::min(left, kNapS)));
}

}  // namespace teletact::client
