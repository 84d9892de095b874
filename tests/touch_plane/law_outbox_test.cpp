#include "service/touch_plane/law_outbox.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

// Two windows of 60 mm, a column of four rows every 5 mm.
class Outbox : public testing::Test {
 protected:
  Outbox() {
    for (int k = 0; k < 2; ++k) {
      auto window = std::make_shared<WindowModel>();
      window->id = 1 + static_cast<std::uint64_t>(k), window->version = 10 + window->id;
      window->region = {0.06 * k, 0.06 * (k + 1)};
      snapshot.windows.push_back(std::move(window));
    }
  }
  static std::shared_ptr<const ContactLaw> law_of(const WindowModel& window) {
    ContactLaw law{{}, true};
    for (int i = 0; i <= 12; ++i) {
      LawColumn& column = law.columns.emplace_back();
      column.x_m = window.region.begin_x_m + 0.005 * i;
      column.rows = 4;
    }
    return std::make_shared<const ContactLaw>(std::move(law));
  }
  std::optional<LawPiece> next(double x_m, double velocity_m_s = 0) {
    auto piece = outbox.next(snapshot, {x_m}, {velocity_m_s}, law_of);
    if (piece && acknowledges) outbox.acknowledge(piece->number);
    return piece;
  }
  SceneSnapshot snapshot;
  LawOutbox outbox;
  bool acknowledges = true;
};

TEST_F(Outbox, SendsWhatIsNearestFirstAndEachColumnOnce) {
  std::multiset<double> sent_m;
  std::uint64_t number = 0;
  double last_m = 0;
  while (const auto piece = next(0.02)) {
    EXPECT_EQ(piece->number, ++number);
    ASSERT_FALSE(piece->columns.empty());
    EXPECT_LE(piece->columns.size(), 3u);  // 340 bytes
    double nearest_m = HUGE_VAL;
    for (const LawColumn& column : piece->columns) {
      EXPECT_EQ(column.version, piece->version);
      EXPECT_GE(column.x_m, piece->begin_m);
      EXPECT_LE(column.x_m, piece->end_m);
      sent_m.insert(column.x_m);
      nearest_m = std::min(nearest_m, std::abs(column.x_m - 0.02));
    }
    EXPECT_GE(nearest_m, last_m);
    last_m = nearest_m;
  }
  EXPECT_EQ(sent_m.size(), 26u);
  EXPECT_EQ(std::set<double>(sent_m.begin(), sent_m.end()).size(), 25u);  // both have one at their border
}

TEST_F(Outbox, SendsAheadOfAFingerThatMoves) {
  const auto piece = next(0.03, 0.2);
  ASSERT_TRUE(piece);
  EXPECT_NEAR(piece->columns[piece->columns.size() / 2].x_m, 0.05, 0.006);
}

// Whoever holds older columns must not drop them before the new ones are there.
TEST_F(Outbox, SaysOverWhichSpanNoColumnOfItsVersionIsMissing) {
  double begin_m = 0.02, end_m = 0.02;
  for (int k = 0; k < 3; ++k) {
    const auto piece = next(0.02);
    ASSERT_TRUE(piece);
    begin_m = std::min(begin_m, piece->columns.front().x_m);
    end_m = std::max(end_m, piece->columns.back().x_m);
    EXPECT_EQ(piece->begin_m, begin_m);
    EXPECT_EQ(piece->end_m, end_m);
  }
}

TEST_F(Outbox, StopsWhereNothingIsAcknowledged) {
  acknowledges = false;
  for (std::uint64_t k = 0; k < LawOutbox::kMaxUnacknowledged; ++k) EXPECT_TRUE(next(0.02));
  EXPECT_FALSE(next(0.02));
  outbox.acknowledge(1);
  EXPECT_TRUE(next(0.02));
  EXPECT_FALSE(next(0.02));
  EXPECT_THROW(outbox.acknowledge(0), std::invalid_argument);
  EXPECT_THROW(outbox.acknowledge(LawOutbox::kMaxUnacknowledged + 2), std::invalid_argument);
  outbox.acknowledge(LawOutbox::kMaxUnacknowledged + 1);
}

TEST_F(Outbox, SendsANewVersionAgainAndNothingOfWindowsFarAway) {
  while (next(0.02)) {
  }
  auto newer = std::make_shared<WindowModel>(*snapshot.windows[0]);
  newer->version = 20;
  snapshot.windows[0] = newer;
  std::size_t columns = 0;
  while (const auto piece = next(0.02)) {
    EXPECT_EQ(piece->version, 20u);
    columns += piece->columns.size();
  }
  EXPECT_EQ(columns, 13u);
  EXPECT_FALSE(next(5.0));
}

TEST_F(Outbox, OwesANewVersionUntilItsColumnsAboutTheFingerAreSent) {
  EXPECT_FALSE(outbox.owes(*snapshot.windows[0], {0.02}))
      << "nothing was told of it yet: no version is held for it";
  while (next(0.02)) {
  }
  EXPECT_FALSE(outbox.expects_more(LawOutbox::Clock::now()));
  EXPECT_FALSE(outbox.owes(*snapshot.windows[0], {0.02}));
  auto newer = std::make_shared<WindowModel>(*snapshot.windows[0]);
  newer->version = 20;
  snapshot.windows[0] = newer;
  EXPECT_TRUE(outbox.owes(*newer, {0.022})) << "not looked at yet";
  const auto nothing = [](const WindowModel&) { return nullptr; };
  EXPECT_FALSE(outbox.next(snapshot, {0.02}, {0}, nothing));
  EXPECT_TRUE(outbox.owes(*newer, {0.022})) << "is being sampled";
  EXPECT_TRUE(outbox.expects_more(LawOutbox::Clock::now()));
  EXPECT_FALSE(outbox.expects_more(LawOutbox::Clock::now() + std::chrono::seconds(1)));
  ASSERT_TRUE(next(0.022));
  EXPECT_FALSE(outbox.owes(*newer, {0.022}));
  EXPECT_TRUE(outbox.owes(*newer, {0.052}));
}

TEST_F(Outbox, OwesUnsampledAndUntoldVersions) {
  snapshot.windows.pop_back();
  while (next(0.02)) {
  }
  const auto publish = [&](std::uint64_t version) {
    auto newer = std::make_shared<WindowModel>(*snapshot.windows[0]);
    newer->version = version;
    snapshot.windows[0] = newer;
  };
  const auto nothing = [](const WindowModel&) { return nullptr; };
  for (const std::uint64_t version : {20, 30}) {
    publish(version);
    EXPECT_FALSE(outbox.next(snapshot, {0.02}, {0}, nothing));
    EXPECT_TRUE(outbox.owes(*snapshot.windows[0], {0.02})) << "version " << version;
  }
  const auto middle = [&](const WindowModel& window) {  // 0.02 to 0.04 m
    const auto all = law_of(window)->columns;
    return std::make_shared<const ContactLaw>(ContactLaw{{all.begin() + 4, all.begin() + 9}, false});
  };
  while (const auto piece = outbox.next(snapshot, {0.03}, {0}, middle)) outbox.acknowledge(piece->number);
  EXPECT_FALSE(outbox.owes(*snapshot.windows[0], {0.031}));
  EXPECT_TRUE(outbox.owes(*snapshot.windows[0], {0.045}));
  EXPECT_TRUE(outbox.owes(*snapshot.windows[0], {0.015}));
}

// It grows at both ends; what was sent is not sent again, and nothing is said of what is not known yet.
TEST_F(Outbox, SendsWhatIsKnownOfALawThatIsBeingSampled) {
  std::ptrdiff_t known = 2;  // columns to either side of the middle
  const auto growing = [&](const WindowModel& window) {
    const auto all = law_of(window);
    ContactLaw law{{all->columns.begin() + 6 - known, all->columns.begin() + 7 + known}, known == 6};
    return std::make_shared<const ContactLaw>(std::move(law));
  };
  snapshot.windows.pop_back();
  std::multiset<double> sent_m;
  for (; known <= 6; known += 2)
    while (const auto piece = outbox.next(snapshot, {0.03}, {0}, growing)) {
      outbox.acknowledge(piece->number);
      for (const LawColumn& column : piece->columns) sent_m.insert(column.x_m);
      EXPECT_GE(piece->begin_m, 0.03 - 0.005 * double(known) - 1e-9);
      EXPECT_LE(piece->end_m, 0.03 + 0.005 * double(known) + 1e-9);
    }
  EXPECT_EQ(sent_m.size(), 13u);
  EXPECT_EQ(std::set<double>(sent_m.begin(), sent_m.end()).size(), 13u);
}

// As when another tip took its place meanwhile.
TEST_F(Outbox, SendsALawThatIsSampledAnewFromElsewhere) {
  snapshot.windows.pop_back();
  const auto whole = law_of(*snapshot.windows[0]);
  const auto columns_of = [&](std::size_t begin, std::size_t end) {
    return [=](const WindowModel& window) {
      const auto all = law_of(window)->columns;
      ContactLaw law{{all.begin() + std::ptrdiff_t(begin), all.begin() + std::ptrdiff_t(end)},
                     begin == 0 && end == 13};
      return std::make_shared<const ContactLaw>(std::move(law));
    };
  };
  std::set<double> sent_m;
  const auto send = [&](const LawOutbox::LawOf& law_of_window) {
    while (const auto piece = outbox.next(snapshot, {0.03}, {0}, law_of_window)) {
      outbox.acknowledge(piece->number);
      for (const LawColumn& column : piece->columns) sent_m.insert(column.x_m);
      // Of the span that is said to rule none is missing.
      for (const LawColumn& column : whole->columns)
        if (column.x_m >= piece->begin_m && column.x_m <= piece->end_m) {
          EXPECT_TRUE(sent_m.contains(column.x_m));
        }
    }
  };
  send(columns_of(0, 6));
  send(columns_of(8, 11));
  send(columns_of(0, 13));
  EXPECT_EQ(sent_m.size(), 13u);
}

TEST_F(Outbox, WaitsForALawThatIsBeingSampled) {
  bool ready = false;
  const auto later = [&](const WindowModel& window) { return ready ? law_of(window) : nullptr; };
  EXPECT_FALSE(outbox.next(snapshot, {0.02}, {0}, later));
  ready = true;
  EXPECT_TRUE(outbox.next(snapshot, {0.02}, {0}, later));
}

// A solid of 30 mm along x, three lanes 10 mm apart.
TEST_F(Outbox, SendsALaneAtATimeAndAgainWhatWasCorrected) {
  auto window = std::make_shared<WindowModel>();
  window->id = 1, window->version = 5;
  window->region = {0, 0.03, RangeZ{-0.01, 0.0101}};
  snapshot.windows = {window};
  ContactLaw law{{}, false};
  for (const double z_m : {-0.01, 0.0, 0.01})
    for (int i = 0; i <= 6; ++i) {
      LawColumn& column = law.columns.emplace_back();
      column.x_m = 0.005 * i, column.z_m = z_m;
      column.of_area = true;
      column.lane_before_m = std::max(z_m - 0.01, -0.01);
      column.rows = 4;
      column.corrected = false;
      column.joined = i > 0;
    }
  auto known = std::make_shared<const ContactLaw>(law);
  const auto law_of_window = [&](const WindowModel&) { return known; };
  const auto send_all = [&] {
    std::vector<LawPiece> pieces;
    while (auto piece = outbox.next(snapshot, {0.015, 0.009}, {}, law_of_window)) {
      outbox.acknowledge(piece->number);
      for (const LawColumn& column : piece->columns) {
        EXPECT_EQ(column.z_m, piece->columns.front().z_m);
        EXPECT_EQ(column.corrected, piece->columns.front().corrected);
        EXPECT_GE(column.x_m, piece->begin_m);
        EXPECT_LE(column.x_m, piece->end_m);
      }
      EXPECT_TRUE(piece->lanes);
      pieces.push_back(std::move(*piece));
    }
    return pieces;
  };
  auto pieces = send_all();
  std::size_t columns = 0;
  for (const LawPiece& piece : pieces) columns += piece.columns.size();
  EXPECT_EQ(columns, 21u);
  EXPECT_EQ(pieces.front().columns.front().z_m, 0.01) << "the lane that is nearest";
  EXPECT_EQ(pieces.front().columns.size(), 2u) << "one alone takes twice the round trips";
  EXPECT_TRUE(outbox.expects_more(LawOutbox::Clock::now()));
  EXPECT_TRUE(send_all().empty());
  for (const std::size_t i : {8u, 9u, 17u}) law.columns[i].corrected = true;
  law.whole = true;
  known = std::make_shared<const ContactLaw>(law);
  pieces = send_all();
  columns = 0;
  for (const LawPiece& piece : pieces) {
    columns += piece.columns.size();
    EXPECT_TRUE(piece.columns.front().corrected);
  }
  EXPECT_EQ(columns, 3u);
  EXPECT_FALSE(outbox.expects_more(LawOutbox::Clock::now()));
}

TEST_F(Outbox, WhereAColumnIsMissingNoPieceReachesAcross) {
  auto window = std::make_shared<WindowModel>();
  window->id = 1, window->version = 5;
  window->region = {0, 0.03, RangeZ{0, 0.01}};
  snapshot.windows = {window};
  ContactLaw law{{}, true};
  for (int i = 0; i <= 6; ++i) {
    if (i == 3) continue;
    LawColumn& column = law.columns.emplace_back();
    column.x_m = 0.005 * i;
    column.rows = 1;
    column.joined = i > 0 && i != 4;
  }
  const auto law_of_window = [&](const WindowModel&) { return std::make_shared<const ContactLaw>(law); };
  while (const auto piece = outbox.next(snapshot, {0.014, 0}, {}, law_of_window)) {
    outbox.acknowledge(piece->number);
    EXPECT_TRUE(piece->end_m < 0.015 || piece->begin_m > 0.015) << piece->begin_m << " " << piece->end_m;
  }
}

}  // namespace
}  // namespace teletact::service
