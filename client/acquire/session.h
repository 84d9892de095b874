// The patient side at work: follows the finger, plans windows, moves the arm, takes frames and uploads them.
//
// Two threads besides the caller's: FingerWatch, and one uploader, so that the arm moves on while the service
// computes. At most kMaxQueuedUploads pairs wait for the uploader; then the arm waits. A slice takes the
// service many times as long as the arm: taken while another is under way it only waits, chosen by where the
// finger was. So the arm takes one at a time, what the service asks for first. While the arm has none to take
// and no finger touches (its force would fade while the model is made anew), slices that a neighbour came to
// are estimated again, with it.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/acquire/estimate_client.h"
#include "client/acquire/finger_watch.h"
#include "client/acquire/frame_source.h"
#include "client/acquire/robot_arm.h"
#include "client/acquire/slice_corrections.h"
#include "client/acquire/slice_scene.h"
#include "client/acquire/window_planner.h"
#include "client/clock/clock.h"
#include "client/link/credentials.h"
#include "teletact/v1/recording.pb.h"

namespace teletact::client {

// Slices of a solid instead of windows of a plane: the arm goes along z.
struct SliceOptions {
  SliceGrid grid;
  double probe_elevation_m = 0;
};

struct AcquireOptions {
  std::string scene_id;
  ArmLimits arm;
  PlannerOptions planner;   // window count and width come from the source
  double start_x_m = 0.03;  // where the finger is expected first
  int start_direction = 1;
  bool until_finger_leaves = false;
  double finger_gone_s = 0.5;  // a finger away that long has left
  double duration_s = 0;       // 0: no limit
  double retry_for_s = 60;     // a service that is started again restores its scenes first
  bool all_maps = false;       // ask for every map of every pair: for recordings
  teletact::v1::ModulusMethod modulus_method =
      teletact::v1::MODULUS_METHOD_UNSPECIFIED;                                    // the service's choice
  teletact::v1::PlaneCondition plane = teletact::v1::PLANE_CONDITION_UNSPECIFIED;  // plane strain
  double modulus_time_limit_s = 0;                                                 // 0: the service's
  teletact::v1::Acquisition stated = {};  // takes the place of what the source states
  // The source's windows are then these slices, the scene is made with the first, and `plane` is SOLID.
  // Without a duration or a finger to wait for all of them are acquired once.
  std::optional<SliceOptions> slices;
};

// What happens, as it happens; every member optional. The calls come from the uploader's thread, `ready` and
// `note` from any.
struct AcquireObserver {
  std::function<void(std::uint32_t call, const teletact::v1::EstimateRequest&)> request;
  std::function<void(std::uint32_t call, const teletact::v1::EstimateResponse&)> response;
  std::function<void(std::uint32_t call, const teletact::v1::WindowTiming&,
                     const teletact::v1::EstimateSummary&)>
      window;
  std::function<void(std::size_t slice, std::uint64_t version)> slice;  // of a solid, after `window`
  // By its neighbours.
  std::function<void(std::size_t slice, std::uint64_t version, const teletact::v1::EstimateSummary&)>
      corrected;
  std::function<void()> ready;                   // what the finger needs first is published
  std::function<void(const std::string&)> note;  // one line for people
};

struct AcquireResult {
  std::vector<teletact::v1::WindowTiming> windows;  // published, in order
  std::size_t refused = 0;                          // pairs that could not be tracked, or told no force
  std::size_t exhausted = 0;                        // windows whose prepared frames are used up
};

class AcquireSession {
 public:
  static constexpr std::size_t kMaxQueuedUploads = 2;

  // The scene must exist, or, with slices, must not. `source` outlives the session.
  AcquireSession(const std::string& address, const Credentials& credentials, FrameSource& source,
                 const AcquireOptions& options, AcquireObserver observer);
  ~AcquireSession();

  // Works until the finger has left, the duration is over, all slices are there and corrected, or `stop` is
  // set. Throws
  // ServiceError when the service refuses a call or stays unavailable.
  AcquireResult run(const std::atomic<bool>& stop);
  // What was published of slices; once run() has ended, however it did.
  const std::map<std::size_t, SlicePlane>& planes() const { return scene_->planes(); }

 private:
  struct Upload {
    FramePair pair;
    std::size_t window;
    teletact::v1::WindowTiming timing;
  };

  void acquire(std::size_t window, const std::atomic<bool>& stop);
  bool has_room();
  void upload_loop();
  void upload_one(Upload upload);
  void correct(std::size_t slice, FramePair pair);
  teletact::v1::SlicePose pose_of(std::size_t window) const;
  // With what the neighbours tell that are there.
  EstimateOutcome estimate(const FramePair& pair, std::size_t window);
  // False, and said, where `work` is refused what `may_fail` names.
  bool done(const std::function<void()>& work, bool (*may_fail)(grpc::StatusCode)) const;
  bool finished(std::int64_t begin_ns);
  bool idle();
  bool all_slices();
  bool all_corrected();
  bool ready();
  FingerMotion finger();
  std::optional<double> wished_m();
  void publish(Upload& upload, const EstimateOutcome& outcome);
  void say_warnings(const PublishedSlice& slice) const;
  void rethrow_failure();
  std::vector<WindowKnowledge> knowledge();
  double now_s() const { return seconds(monotonic_ns() - epoch_ns_); }
  void sleep_until(double time_s, const std::atomic<bool>& stop) const;

  const std::string address_;
  const Credentials credentials_;
  FrameSource& source_;
  AcquireOptions options_;
  AcquireObserver observer_;
  WindowPlanner planner_;
  std::int64_t epoch_ns_;  // time 0 of the arm and of the scanner's ticks
  RobotArm arm_;
  EstimateClient client_;
  std::optional<FingerWatch> finger_;  // of a scene that is there
  std::optional<teletact::v1::SliceWish> wish_;
  bool ignored_ = false;  // a wish; it was said

  // The uploader's alone.
  std::uint32_t calls_ = 0;
  std::optional<SliceScene> scene_;

  std::mutex mutex_;  // guards all below
  std::condition_variable changed_;
  std::deque<Upload> queue_;
  std::optional<SliceCorrections> corrections_;  // of slices
  bool uploading_ = false;
  bool resting_ = false, correcting_ = false;  // nothing is asked of the arm, nor of the scene
  bool closing_ = false, scene_made_ = false;
  std::vector<std::optional<double>> acquired_s_;
  std::vector<std::uint32_t> passes_;
  std::exception_ptr failure_;
  AcquireResult result_;
  std::atomic<bool> abandon_{false};
  std::thread uploader_;
};

}  // namespace teletact::client
