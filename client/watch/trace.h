// What the servo did, in rows of 10 ms: the last minute of them. A row's times and delays are the largest of
// its ticks, so that no late tick is lost between two pixels.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "client/watch/frame.h"
#include "teletact/v1/recording.pb.h"

namespace teletact::client {

class Trace {
 public:
  static constexpr double kRowS = 0.01, kKeptS = 60;
  static constexpr std::size_t kColumns = 21;
  using Row = std::array<float, kColumns>;
  static const std::array<const char*, kColumns>& columns();  // their names, with units

  // True when a row is complete.
  bool add(std::int64_t time_ns, const v1::ServoSample& tick, const std::optional<v1::ForceBudget>&);
  // The row of the last ticks, which waits for no more of them; false: there is none.
  bool complete();
  void clear();
  std::uint64_t rows() const { return first_ + rows_.size(); }  // so far
  double begin_s() const { return begin_s_; }
  // Those from number `from` on that are still kept.
  Slot slot(std::uint64_t from) const;

 private:
  std::optional<std::int64_t> begin_ns_;
  double begin_s_ = 0, row_s_ = 0, last_s_ = 0;
  Row row_{};
  bool open_ = false;
  std::uint64_t first_ = 0;  // number of the oldest row
  std::deque<Row> rows_;
};

}  // namespace teletact::client
