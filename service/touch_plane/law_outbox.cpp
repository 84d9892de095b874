#include "service/touch_plane/law_outbox.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "service/plan/choices.h"

namespace teletact::service {
namespace {

std::size_t bytes_of(const LawColumn& column) {  // on the wire, about
  return 20 + column.rows * (sizeof(float) + sizeof(LawSample));
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

// A law that is being sampled grows; one that is sampled anew, from elsewhere, has other columns.
void LawOutbox::grow(Sent& sent, std::shared_ptr<const ContactLaw> law) {
  if (!law || law == sent.law) return;
  std::vector<bool> columns(law->columns.size());
  const auto before = [](const LawColumn& one, const LawColumn& other) { return one.x_m < other.x_m; };
  for (std::size_t i = 0; sent.law && i < columns.size(); ++i) {
    const auto& known = sent.law->columns;
    const auto at = std::lower_bound(known.begin(), known.end(), law->columns[i], before);
    columns[i] = at != known.end() && at->x_m == law->columns[i].x_m &&
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
    if (!sent.law || !sent.law->whole) grow(sent, law_of(*window));
  }
  windows_ = std::move(near);
}

std::optional<LawPiece> LawOutbox::next(const SceneSnapshot& snapshot, double x_m, double velocity_m_s,
                                        const LawOf& law_of, double farthest_m) {
  if (sent_ - acknowledged_ >= kMostUnacknowledged) return std::nullopt;
  look(snapshot, x_m, law_of);
  const double ahead_m = x_m + choices::kLawAhead * velocity_m_s;
  double least_m = farthest_m;
  std::uint64_t window_id = 0;
  std::size_t nearest = 0;
  for (const auto& [id, sent] : windows_)
    for (std::size_t i = 0; i < sent.columns.size(); ++i) {
      const double off_m = std::abs(sent.law->columns[i].x_m - ahead_m);
      if (!sent.columns[i] && off_m < least_m) least_m = off_m, window_id = id, nearest = i;
    }
  if (!(least_m < farthest_m)) return std::nullopt;
  return piece_of(window_id, windows_.at(window_id), nearest);
}

bool LawOutbox::expects_more(Clock::time_point now) const {
  if (sent_ - acknowledged_ >= kMostUnacknowledged) return false;  // the acknowledgement wakes
  return std::any_of(windows_.begin(), windows_.end(), [now](const auto& window) {
    const Sent& sent = window.second;
    const bool unsent = std::find(sent.columns.begin(), sent.columns.end(), false) != sent.columns.end();
    const bool grows = !sent.law || !sent.law->whole;
    return unsent || (grows && now - sent.since < choices::kLawExpected);
  });
}

bool LawOutbox::owes(const WindowModel& window, double x_m) const {
  if (sent_ - acknowledged_ >= kMostUnacknowledged) return false;  // nothing can be told now
  const auto known = windows_.find(window.id);
  if (known == windows_.end()) return false;
  const Sent& sent = known->second;
  if (sent.version != window.version) return sent.law || sent.follows;  // it is looked at next
  if (!sent.follows || !sent.law) return sent.follows;
  const auto& columns = sent.law->columns;
  const auto right = static_cast<std::size_t>(
      std::upper_bound(columns.begin(), columns.end(), x_m,
                       [](double x, const LawColumn& column) { return x < column.x_m; }) -
      columns.begin());
  if (!sent.law->whole && (right == 0 || right == columns.size())) return true;
  return (right > 0 && !sent.columns[right - 1]) || (right < columns.size() && !sent.columns[right]);
}

// The nearest column, and as many unsent ones beside it as fit, on either side by turns.
LawPiece LawOutbox::piece_of(std::uint64_t window_id, Sent& sent, std::size_t nearest) {
  const std::vector<LawColumn>& columns = sent.law->columns;
  std::size_t begin = nearest, end = nearest + 1, bytes = bytes_of(columns[nearest]);
  const auto fits = [&](std::size_t i) {
    return i < columns.size() && !sent.columns[i] && bytes + bytes_of(columns[i]) <= choices::kLawPieceBytes;
  };
  for (bool grown = true; grown;) {
    grown = false;
    if (fits(end)) bytes += bytes_of(columns[end++]), grown = true;
    if (begin > 0 && fits(begin - 1)) bytes += bytes_of(columns[--begin]), grown = true;
  }
  LawPiece piece{++sent_, window_id, sent.version, 0, 0, {}};
  for (std::size_t i = begin; i < end; ++i) {
    piece.columns.push_back(columns[i]);
    piece.columns.back().version = sent.version;
    sent.columns[i] = true;
  }
  while (begin > 0 && sent.columns[begin - 1]) --begin;
  while (end < columns.size() && sent.columns[end]) ++end;
  piece.begin_m = columns[begin].x_m, piece.end_m = columns[end - 1].x_m;
  return piece;
}

}  // namespace teletact::service
