#include "client/link/law_book.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace teletact::client {
namespace {

v1::LawPiece piece_of(std::uint64_t number, const std::vector<double>& x_m, std::uint64_t version = 1) {
  v1::LawPiece piece;
  piece.set_piece(number);
  piece.set_model_version(version);
  piece.set_begin_x_m(x_m.front());
  piece.set_end_x_m(x_m.back());
  piece.set_force_error_share(0.005F);
  piece.set_force_error_n(0.001F);
  for (const double x : x_m) {
    v1::LawColumn* column = piece.add_columns();
    column->set_x_m(x);
    for (const double d : {3e-4, 8e-3}) {
      column->add_log_indentation(float(std::log(d)));
      for (const float value : {float(6 + 2.5 * std::log(d)), 0.0F, 2.5F, 0.0F}) column->add_samples(value);
    }
  }
  return piece;
}

LawBook book_with(std::initializer_list<v1::LawPiece> pieces) {
  LawBook book;
  book.open(0);
  for (const v1::LawPiece& piece : pieces) EXPECT_TRUE(book.take(piece, 0.02));
  return book;
}

// Whether the servo is given a law around x, in part of `version` or newer.
bool covers(LawBook book, double x_m, std::uint64_t version) {
  book.fresh(x_m + 1);  // it has gone elsewhere since
  const LawValue value = evaluate(book.fresh(x_m)->used(), x_m, 0.002);
  return value.covered && value.newest >= version;
}

TEST(LawBook, GivesTheServoWhatIsNearTheFingerOnceForEachChange) {
  LawBook book = book_with({piece_of(1, {0.01, 0.02, 0.03})});
  const auto law = book.fresh(0.02);
  ASSERT_TRUE(law);
  ASSERT_EQ(law->count, 3u);
  EXPECT_TRUE(evaluate(law->used(), 0.015, 0.002).covered);
  EXPECT_FALSE(book.fresh(0.021));
  EXPECT_TRUE(book.fresh(0.03));
  EXPECT_TRUE(book.take(piece_of(2, {0.035}), 0.03));
  EXPECT_EQ(book.pieces(), 2u);
  EXPECT_TRUE(book.fresh(0.03));
}

TEST(LawBook, ColumnWithoutAnErrorHasItsPieces) {
  v1::LawPiece piece = piece_of(1, {0.01, 0.02, 0.03});
  piece.mutable_columns(1)->set_of_force_error(0.25F), piece.mutable_columns(2)->set_of_force_error(0.5F);
  const auto law = book_with({piece}).fresh(0.02);
  ASSERT_TRUE(law);
  EXPECT_FLOAT_EQ(law->columns[0].error_n, 0.001F);
  EXPECT_FLOAT_EQ(law->columns[1].error_n, 0.00025F);
  EXPECT_FLOAT_EQ(law->columns[2].error_share, 0.0025F);
}

TEST(LawBook, InterpolatesNothingOverAGap) {
  LawBook book = book_with({piece_of(1, {0.01, 0.02}), piece_of(2, {0.04, 0.05})});
  EXPECT_TRUE(covers(book, 0.015, 1));
  EXPECT_FALSE(covers(book, 0.03, 1));
  EXPECT_FALSE(evaluate(book.fresh(0.03)->used(), 0.03, 0.002).covered);
  v1::LawPiece between = piece_of(3, {0.03});
  between.set_begin_x_m(0.01), between.set_end_x_m(0.05);  // now none is missing
  EXPECT_TRUE(book.take(between, 0.03));
  EXPECT_TRUE(covers(book, 0.03, 1) && covers(book, 0.025, 1) && covers(book, 0.045, 1));
}

TEST(LawBook, ANewerVersionTakesThePlaceOfTheOlderWhereItRules) {
  LawBook book = book_with({piece_of(1, {0.01, 0.015, 0.02, 0.03, 0.04}), piece_of(2, {0.01, 0.02}, 2)});
  const auto law = book.fresh(0.02);
  ASSERT_EQ(law->count, 4u);  // not 15 mm: it was the older one's
  EXPECT_EQ(law->columns[1].x_m, 0.02);
  EXPECT_EQ(law->columns[1].version, 2u);
  EXPECT_EQ(law->columns[2].version, 1u);
  EXPECT_TRUE(covers(book, 0.025, 2));  // across the border of versions
  EXPECT_FALSE(covers(book, 0.035, 2));
  // An older one that is late changes nothing that rules.
  EXPECT_TRUE(book.take(piece_of(3, {0.015, 0.02}), 0.02));
  EXPECT_EQ(book.fresh(0.02)->count, 4u);
  EXPECT_EQ(book.fresh(0.03)->columns[1].version, 2u);
}

TEST(LawBook, NewerVersionAmidAnOlderLeavesNoGap) {
  LawBook book = book_with({piece_of(1, {0.01, 0.02, 0.03}), piece_of(2, {0.02, 0.03}, 2)});
  EXPECT_TRUE(covers(book, 0.015, 2));
  book = book_with({piece_of(1, {0.01, 0.02}), piece_of(2, {0.03, 0.04}), piece_of(3, {0.03, 0.04}, 2)});
  EXPECT_FALSE(covers(book, 0.025, 1));
}

TEST(LawBook, AStreamThatOpensAgainKnowsNothing) {
  LawBook book = book_with({piece_of(1, {0.01, 0.02})});
  book.open(0.005);
  EXPECT_FALSE(covers(book, 0.015, 0));
  EXPECT_EQ(book.pieces(), 0u);
  EXPECT_EQ(book.fresh(0.015)->count, 0u);
}

TEST(LawBook, RefusesWhatIsMalformedAndKeepsWhatItHas) {
  LawBook book = book_with({piece_of(1, {0.01, 0.02})});
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [&](auto change) {
    v1::LawPiece piece = piece_of(2, {0.03, 0.04});
    change(piece);
    LawBook other = book;
    return !other.take(piece, 0.02) && covers(other, 0.015, 1) && !covers(other, 0.035, 1);
  };
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.set_piece(3); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.set_piece(1); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.clear_columns(); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.mutable_columns(0)->add_samples(1); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.mutable_columns(0)->set_log_indentation(1, -20); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.mutable_columns(1)->set_x_m(0.03); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.mutable_columns(1)->set_x_m(0.05); }));  // beyond its span
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.mutable_columns(1)->set_samples(0, NAN); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.mutable_columns(1)->set_samples(2, -1); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.mutable_columns(1)->set_x_m(11), p.set_end_x_m(11); }));
  EXPECT_TRUE(refused([&](v1::LawPiece& p) { p.set_begin_x_m(kNan); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.set_force_error_share(2); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.set_force_error_n(-1); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) { p.mutable_columns(0)->set_of_force_error(-1); }));
  EXPECT_TRUE(refused([](v1::LawPiece& p) {
    for (int k = 0; k < 70; ++k) *p.add_columns() = p.columns(1);
  }));
}

// One window's bad piece takes no law from the others.
TEST(LawBook, APieceThatIsRefusedIsAcknowledgedAllTheSame) {
  LawBook book = book_with({piece_of(1, {0.01, 0.02})});
  v1::LawPiece bad = piece_of(2, {0.03, 0.04});
  bad.mutable_columns(0)->set_samples(0, NAN);
  EXPECT_FALSE(book.take(bad, 0.02));
  EXPECT_EQ(book.pieces(), 2u);
  EXPECT_FALSE(book.take(piece_of(4, {0.05, 0.06}), 0.02));
  EXPECT_EQ(book.pieces(), 2u);
  EXPECT_TRUE(book.take(piece_of(3, {0.05, 0.06}), 0.02));
}

TEST(LawBook, IsBoundedWhateverASenderSends) {
  LawBook book;
  book.open(0);
  std::uint64_t number = 0;
  for (int k = 0; k < 4000; ++k)
    ASSERT_TRUE(book.take(piece_of(++number, {0.002 * k, 0.002 * k + 0.001}), 4.0));
  const auto law = book.fresh(4.0);
  EXPECT_EQ(law->count, NearLaw::kMax);
  // As far to the left of the finger as to the right.
  EXPECT_NEAR(law->columns[0].x_m, 4.0 - 0.032, 0.002);
  EXPECT_NEAR(law->columns[NearLaw::kMax - 1].x_m, 4.0 + 0.032, 0.002);
  EXPECT_FALSE(covers(book, 0.0005, 0));
}

// A lane of a solid's law.
v1::LawPiece lane_of(std::uint64_t number, double z_m, double before_m, std::vector<double> x_m,
                     std::uint64_t version = 1) {
  v1::LawPiece piece = piece_of(number, x_m, version);
  piece.set_z_m(z_m), piece.set_lane_before_m(before_m);
  for (v1::LawColumn& column : *piece.mutable_columns()) {
    column.clear_samples();
    for (const double d : {3e-4, 8e-3})
      for (const float value : {float(6 + 2.5 * std::log(d)), 0.0F, 2.5F, 0.0F, 30.0F, 0.0F, 0.0F, 0.0F})
        column.add_samples(value);
  }
  return piece;
}
LawValue felt(LawBook book, double x_m, double z_m, bool guesses = true) {
  book.fresh(x_m + 1, z_m + 1);  // it has gone elsewhere since
  return evaluate(book.fresh(x_m, z_m, guesses)->used(), x_m, 0.002, z_m);
}

TEST(LawBook, LanesCoverWhatLiesBetweenThemAndAreFeltAcross) {
  LawBook book =
      book_with({lane_of(1, 0.000, 0.000, {0.01, 0.02, 0.03}), lane_of(2, 0.006, 0.000, {0.01, 0.02, 0.03}),
                 lane_of(3, 0.018, 0.012, {0.01, 0.02, 0.03})});
  const LawValue value = felt(book, 0.015, 0.003);
  EXPECT_TRUE(value.covered);
  EXPECT_NE(value.by_z_n, 0);
  EXPECT_FALSE(felt(book_with({lane_of(1, 0, 0, {0.01, 0.02})}), 0.015, 0).covered) << "one lane";
  EXPECT_FALSE(felt(book, 0.015, 0.008).covered) << "a lane is missing";
  EXPECT_TRUE(book.take(lane_of(4, 0.012, 0.006, {0.01, 0.02}), 0.02, 0.008));
  EXPECT_TRUE(felt(book, 0.015, 0.008).covered);
  EXPECT_TRUE(felt(book, 0.015, 0.015).covered);
  EXPECT_FALSE(felt(book, 0.025, 0.008).covered);
}

TEST(LawBook, AGuessIsReplacedAndGivenToThoseAloneWhoAskForGuesses) {
  v1::LawPiece guess = lane_of(1, 0, 0, {0.01, 0.02, 0.03}), other = lane_of(2, 0.006, 0, {0.01, 0.02, 0.03});
  guess.set_guess(true), other.set_guess(true);
  LawBook book = book_with({guess, other});
  EXPECT_TRUE(felt(book, 0.015, 0.003).covered);
  EXPECT_FALSE(felt(book, 0.015, 0.003).corrected);
  EXPECT_FALSE(felt(book, 0.015, 0.003, false).covered);
  // Corrected one by one: the span tells that none is missing.
  const auto corrected = [&](std::uint64_t number, double z_m, double x_m) {
    v1::LawPiece piece = lane_of(number, z_m, 0, {x_m});
    piece.set_begin_x_m(0.01), piece.set_end_x_m(0.03);
    EXPECT_TRUE(book.take(piece, 0.02, 0.003));
  };
  corrected(3, 0, 0.02), corrected(4, 0, 0.03), corrected(5, 0.006, 0.02);
  EXPECT_FALSE(felt(book, 0.025, 0.003, false).covered) << "a corner is a guess";
  corrected(6, 0.006, 0.03);
  EXPECT_TRUE(felt(book, 0.025, 0.003, false).covered);
  EXPECT_TRUE(felt(book, 0.025, 0.003, false).corrected);
  EXPECT_FALSE(felt(book, 0.015, 0.003, false).covered);
  EXPECT_TRUE(felt(book, 0.015, 0.003).covered);
  corrected(7, 0, 0.01), corrected(8, 0.006, 0.01);
  EXPECT_TRUE(felt(book, 0.015, 0.003, false).covered);
}

TEST(LawBook, OfManyLanesTheServoIsGivenThoseAroundTheFinger) {
  LawBook book = book_with({});
  std::vector<double> x_m;
  for (int i = 0; i < 20; ++i) x_m.push_back(0.005 * i);
  for (int lane = 0; lane < 20; ++lane)
    EXPECT_TRUE(book.take(lane_of(std::uint64_t(lane) + 1, 0.005 * lane, 0.005 * std::max(lane - 1, 0), x_m),
                          0.05, 0.05));
  const auto law = book.fresh(0.052, 0.048);
  ASSERT_TRUE(law);
  EXPECT_EQ(law->count, 64u);
  for (const double x : {0.036, 0.052, 0.066})
    for (const double z : {0.033, 0.048, 0.063})
      EXPECT_TRUE(evaluate(law->used(), x, 0.002, z).covered) << x << z;
  EXPECT_FALSE(book.fresh(0.053, 0.049));
  EXPECT_TRUE(book.fresh(0.053, 0.060));
}

TEST(LawBook, LanesInNoOrderAreRefused) {
  LawBook book = book_with({});
  EXPECT_FALSE(book.take(lane_of(1, 0.006, 0.012, {0.01, 0.02}), 0.02));
  EXPECT_FALSE(book.take(lane_of(2, std::nan(""), 0, {0.01, 0.02}), 0.02));
  EXPECT_FALSE(book.take(lane_of(3, 1e9, 0, {0.01, 0.02}), 0.02));
  v1::LawPiece five = lane_of(4, 0, 0, {0.01, 0.02});
  five.mutable_columns(0)->mutable_samples()->Truncate(10);
  EXPECT_FALSE(book.take(five, 0.02));
  EXPECT_EQ(book.fresh(0.015)->count, 0u);
}

}  // namespace
}  // namespace teletact::client
