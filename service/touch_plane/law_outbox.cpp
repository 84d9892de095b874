#include "service/touch_plane/law_outbox.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "service/base/choices.h"

namespace teletact::service {
namespace {

std::size_t bytes_of(const LawColumn& column, bool lanes) {  // on the wire, about
  const std::size_t numbers = 1 + (lanes ? LawSample::kOfAnArea : LawSample::kOfAPlane);
  return 20 + column.rows * numbers * sizeof(float);
}

bool before(const LawColumn& one, const LawColumn& other) {
  return std::pair(one.z_m, one.x_m) < std::pair(other.z_m, other.x_m);
}

}  // namespace

void LawOutbox::acknowledge(std::uint64_t pieces) {
  if (pieces > sent_ || pieces < acknowledged_)
    throw std::invalid_argument(
        fmt::format("pose.laws_acknowledged: {}, but {} pieces were sent and {} acknowledged; give the "
                    "number of the newest "
                    "piece received",
                    pieces, sent_.load(), acknowledged_.load()));
  acknowledged_ = pieces;
}

// A law that is being sampled grows and is corrected; one that is sampled anew, from elsewhere, has other
// columns.
void LawOutbox::grow(Sent& sent, std::shared_ptr<const ContactLaw> law) {
  if (!law || law == sent.law) return;
  std::vector<bool> columns(law->columns.size());
  for (std::size_t i = 0; sent.law && i < columns.size(); ++i) {
    const auto& known = sent.law->columns;
    const auto at = std::lower_bound(known.begin(), known.end(), law->columns[i], before);
    columns[i] = at != known.end() && !before(law->columns[i], *at) &&
                 at->corrected == law->columns[i].corrected &&
                 sent.columns[static_cast<std::size_t>(at - known.begin())];
  }
  sent.columns = std::move(columns);
  sent.law = std::move(law);
}

// Windows within reach, at their present version; the others are forgotten, and sent again on return.
void LawOutbox::look(const SceneSnapshot& snapshot, double x_m, const LawOf& law_of) {
  std::map<std::uint64_t, Sent> near;
  for (const auto& window : snapshot.windows) {
    if (x_m < window->region.begin_x_m - choices::kLawReach ||
        x_m > window->region.end_x_m + choices::kLawReach)
      continue;
    Sent& sent = near[window->id];
    const auto known = windows_.find(window->id);
    if (known != windows_.end() && known->second.version == window->version) {
      sent = std::move(known->second);
    } else {
      sent.since = Clock::now();
      sent.follows = known != windows_.end() && (known->second.law || known->second.follows);
    }
    sent.version = window->version;
    sent.lanes = window->region.z.has_value();
    if (!sent.law || !sent.law->whole) grow(sent, law_of(*window));
  }
  windows_ = std::move(near);
}

std::optional<LawPiece> LawOutbox::next(const SceneSnapshot& snapshot, Along place_m, Along velocity_m_s,
                                        const LawOf& law_of, double farthest_m) {
  if (sent_ - acknowledged_ >= kMaxUnacknowledged) return std::nullopt;
  look(snapshot, place_m.x, law_of);
  const Along ahead_m{place_m.x + choices::kLawAhead * velocity_m_s.x,
                      place_m.z + choices::kLawAhead * velocity_m_s.z};
  double min_m = farthest_m;
  std::uint64_t window_id = 0;
  std::size_t nearest = 0;
  for (const auto& [id, sent] : windows_)
    for (std::size_t i = 0; i < sent.columns.size(); ++i) {
      const LawColumn& column = sent.law->columns[i];
      const double off_m = std::hypot(column.x_m - ahead_m.x, sent.lanes ? column.z_m - ahead_m.z : 0);
      if (!sent.columns[i] && off_m < min_m) min_m = off_m, window_id = id, nearest = i;
    }
  if (!(min_m < farthest_m)) return std::nullopt;
  return piece_of(window_id, windows_.at(window_id), nearest);
}

bool LawOutbox::expects_more(Clock::time_point now) const {
  if (sent_ - acknowledged_ >= kMaxUnacknowledged) return false;  // the acknowledgement wakes
  return std::any_of(windows_.begin(), windows_.end(), [now](const auto& window) {
    const Sent& sent = window.second;
    const bool unsent = std::find(sent.columns.begin(), sent.columns.end(), false) != sent.columns.end();
    const bool grows = !sent.law || !sent.law->whole;
    return unsent || (grows && now - sent.since < choices::kLawExpected);
  });
}

bool LawOutbox::owes(const WindowModel& window, Along place_m) const {
  if (sent_ - acknowledged_ >= kMaxUnacknowledged) return false;  // nothing can be told now
  const auto known = windows_.find(window.id);
  if (known == windows_.end()) return false;
  const Sent& sent = known->second;
  if (sent.version != window.version) return sent.law || sent.follows;  // it is looked at next
  if (!sent.follows || !sent.law) return sent.follows;
  const LawCell cell = cell_at(sent.law->columns, place_m.x, place_m.z);
  if (cell.count == 0) return !sent.law->whole;
  const auto begin = cell.columns.begin();
  return std::any_of(begin, begin + cell.count, [&](std::size_t i) { return !sent.columns[i]; });
}

// The nearest column, and as many unsent ones of its lane beside it as fit, on either side by turns.
LawPiece LawOutbox::piece_of(std::uint64_t window_id, Sent& sent, std::size_t nearest) {
  const std::vector<LawColumn>& columns = sent.law->columns;
  const auto size = [&](std::size_t i) { return bytes_of(columns[i], sent.lanes); };
  std::size_t begin = nearest, end = nearest + 1, bytes = size(nearest);
  // None is missing between it and the one before it.
  const auto linked = [&](std::size_t i) {
    return i > 0 && i < columns.size() && columns[i].z_m == columns[i - 1].z_m && columns[i].joined;
  };
  const auto fits = [&](std::size_t i) {
    return !sent.columns[i] && columns[i].corrected == columns[nearest].corrected &&
           bytes + size(i) <= choices::kLawPieceBytes;
  };
  for (bool grown = true; grown;) {
    grown = false;
    if (linked(end) && fits(end)) bytes += size(end++), grown = true;
    if (linked(begin) && fits(begin - 1)) bytes += size(--begin), grown = true;
  }
  LawPiece piece{++sent_, window_id, sent.version, 0, 0, sent.lanes, {}};
  for (std::size_t i = begin; i < end; ++i) {
    piece.columns.push_back(columns[i]);
    piece.columns.back().version = sent.version;
    sent.columns[i] = true;
  }
  while (linked(begin) && sent.columns[begin - 1]) --begin;
  while (linked(end) && sent.columns[end]) ++end;
  piece.begin_m = columns[begin].x_m, piece.end_m = columns[end - 1].x_m;
  return piece;
}

}  // namespace teletact::service
