// What a touch stream's messages say: checked, counted and, where a person should know, said in the log.
// Nothing here waits, and nothing is safe from two threads: the link's lock guards it.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "client/link/arrival_intervals.h"
#include "client/link/force_terms.h"
#include "client/link/pacing.h"
#include "client/servo/clock_offset.h"
#include "client/servo/histogram.h"
#include "client/servo/servo_loop.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::client {

struct TouchLinkStats {
  std::uint64_t poses = 0;     // sent
  std::uint64_t answers = 0;   // received
  std::uint64_t distinct = 0;  // of them, to a pose at another position than the answer before
  std::uint64_t not_covered = 0;
  std::uint64_t failed = 0;     // no force came: status FAILED, or one that is not known here
  std::uint64_t preparing = 0;  // status PREPARING
  std::uint64_t degraded = 0;   // status DEGRADED
  double largest_strain = 0;    // under the finger
  std::map<v1::SolvePath, std::uint64_t> solved_by;  // answers in contact, by the model that gave them
  Histogram force_budget;          // half of the 95 % interval over the force, of answers that state it
  double largest_above = 0;        // what it reaches further up than down
  ForceTerms made_by;              // summed over the answers
  std::uint64_t dropped = 0;       // malformed or foreign answers
  std::uint64_t law_pieces = 0;    // of contact laws
  std::uint64_t laws_dropped = 0;  // malformed ones
  std::uint64_t tactile_images = 0, tactile_dropped = 0;  // the same of tactile images
  std::uint64_t streams = 0;                              // opened, the first included
  std::uint64_t instances = 0;                            // service processes seen
  std::uint64_t last_version = 0;                         // model version of the last answer
  Histogram latencies_s;      // pose sampled -> answer received, of the distinct ones
  double first_answer_s = 0;  // servo clock
  double last_answer_s = 0;
  double layer_depth_m = 0;         // in use
  double period_s = 0;              // that the service keeps: negotiated, longer while it is busy
  Histogram round_trips_s;          // pose sent -> answer received, less what the service took
  double clock_offset_s = 0;        // the service's clock minus ours, by the newest answer
  double clock_offset_error_s = 0;  // at most
};

class TouchAnswers {
 public:
  // What is wrong with it, the field named; empty when it can be worked with, and is from now on.
  std::string take_opened(const v1::TouchOpened& opened, std::int64_t received_ns);
  // `sent_ns`: when its pose went out on the servo's clock; 0: not known. `ours`: it answers a pose of this
  // link. None when it is not, or is malformed.
  std::optional<ServoAnswer> take_answer(const v1::TouchAnswer& answer, bool ours, std::int64_t sent_ns,
                                         std::int64_t received_ns);

  TouchLinkStats stats;
  Pacing pacing;                             // of the current stream
  bool covered() const { return covered_; }  // the last answer's; true before there is any
  double round_trip_s() const { return clock_offset_.round_trip_s(); }

 private:
  void keep_period(double period_s);
  void take_stamps(const v1::TouchAnswer& answer, std::int64_t sent_ns, ServoAnswer& converted);
  void say_what_it_warns_of(const v1::TouchAnswer& answer, std::int64_t received_ns);
  void say_how_far_away();
  void say_whether_prepared(const v1::TouchAnswer& answer);
  void say_who_steers(bool steers, const std::string& steered_by);

  std::int64_t warned_ns_ = -1'000'000'000;  // when an answer's warning was logged last
  bool remarked_ = false, preparing_ = false, far_away_ = false;
  ArrivalIntervals arrivals_;  // on the current stream
  TouchedSurface surface_;
  std::string who_steers_;  // as it was said last
  bool covered_ = true;
  std::uint64_t service_instance_ = 0;
  ClockOffset clock_offset_;
  Vector3 last_position_m_{1e300, 1e300, 1e300};
};

}  // namespace teletact::client
