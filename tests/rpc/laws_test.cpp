// Contact laws as they travel: what a client reads of the messages is what was sampled.
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "common/contact_law.h"
#include "service/rpc/touch_messages.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {
namespace {

// As the contract says it, not as the product reads it.
LawColumn column_from(const v1::LawPiece& piece, int k) {
  const v1::LawColumn& in = piece.columns(k);
  LawColumn column;
  column.x_m = in.x_m();
  column.version = piece.model_version();
  const float share = in.of_force_error() == 0 ? 1 : in.of_force_error();
  column.error_share = share * piece.force_error_share();
  column.error_n = share * piece.force_error_n();
  for (int i = 0; i < in.log_indentation_size(); ++i) {
    column.log_depth[column.rows] = in.log_indentation(i);
    column.samples[column.rows++] = {in.samples(4 * i), in.samples(4 * i + 1), in.samples(4 * i + 2),
                                     in.samples(4 * i + 3)};
  }
  return column;
}

TEST(LawMessages, SayOfEachColumnWhatWasSampledAndItsOwnError) {
  LawPiece piece{7, 3, 11, -0.01, 0.05, false, {}};
  for (int k = 0; k < 3; ++k) {
    LawColumn& column = piece.columns.emplace_back();
    column.x_m = 0.01 * k;
    column.error_share = 0.005F * float(k == 1 ? 4 : 1), column.error_n = 0.2F * column.error_share;
    column.rows = static_cast<std::uint8_t>(k + 1);
    for (std::size_t i = 0; i < column.rows; ++i) {
      const float at = float(k) + 0.1F * float(i);
      column.log_depth[i] = at;
      column.samples[i] = {at + 10, at + 20, at + 30, at + 40};
    }
  }
  v1::LawPiece told;
  told.set_piece(1), told.add_columns();  // whatever it held before
  law_to(piece, &told);
  EXPECT_EQ(told.piece(), 7U);
  EXPECT_EQ(told.window_id(), 3U);
  EXPECT_EQ(told.begin_x_m(), -0.01);
  EXPECT_EQ(told.end_x_m(), 0.05);
  ASSERT_EQ(told.columns_size(), 3);
  for (int k = 0; k < 3; ++k) {
    const LawColumn read = column_from(told, k), &sent = piece.columns[static_cast<std::size_t>(k)];
    EXPECT_LE(told.columns(k).of_force_error(), 1);
    EXPECT_EQ(read.x_m, sent.x_m);
    EXPECT_EQ(read.version, 11U);
    EXPECT_FLOAT_EQ(read.error_share, sent.error_share);
    EXPECT_FLOAT_EQ(read.error_n, sent.error_n);
    ASSERT_EQ(read.rows, sent.rows);
    for (std::size_t i = 0; i < sent.rows; ++i) {
      EXPECT_EQ(read.log_depth[i], sent.log_depth[i]);
      EXPECT_EQ(read.samples[i].log_energy, sent.samples[i].log_energy);
      EXPECT_EQ(read.samples[i].by_x_1_m, sent.samples[i].by_x_1_m);
      EXPECT_EQ(read.samples[i].by_log_depth, sent.samples[i].by_log_depth);
      EXPECT_EQ(read.samples[i].mixed_1_m, sent.samples[i].mixed_1_m);
    }
  }
}

TEST(LawMessages, StateASolidLanesPlaceAndWhetherItIsAGuess) {
  LawPiece piece{7, 3, 11, 0, 0, true, {}};
  LawColumn& column = piece.columns.emplace_back();
  column.z_m = 0.012, column.lane_before_m = 0.006;
  column.corrected = false;
  column.error_share = 0.1F, column.error_n = 0.002F;
  column.rows = 1;
  column.samples[0] = {1, 2, 3, 4, 5, 6, 7, 8};
  piece.columns.push_back(column);
  piece.columns[1].x_m = 0.006;
  piece.columns[1].error_share = 0.02F, piece.columns[1].error_n = 0.004F;  // another ratio
  v1::LawPiece told;
  law_to(piece, &told);
  EXPECT_EQ(told.z_m(), 0.012);
  EXPECT_EQ(told.lane_before_m(), 0.006);
  EXPECT_TRUE(told.guess());
  ASSERT_EQ(told.columns(0).samples_size(), 8);
  for (int i = 0; i < 8; ++i) EXPECT_EQ(told.columns(0).samples(i), float(i + 1));
  for (int k = 0; k < 2; ++k) {  // never less than was stated
    const LawColumn read = column_from(told, k), &sent = piece.columns[std::size_t(k)];
    EXPECT_GE(read.error_share, sent.error_share * 0.9999F);
    EXPECT_GE(read.error_n, sent.error_n * 0.9999F);
  }
  piece.columns[0].corrected = piece.columns[1].corrected = true;
  law_to(piece, &told);
  EXPECT_FALSE(told.guess());
}

class Laws : public OnOneServer {
 protected:
  Laws() {
    v1::TouchOpen open = Toucher::open_on("s");
    open.set_laws(true);
    toucher = std::make_unique<Toucher>(channel, open);
    EXPECT_TRUE(toucher->opened());
  }
  void TearDown() override {
    toucher.reset();
    OnOneServer::TearDown();
  }
  // A pose, what comes up to its answer, and that.
  v1::TouchAnswer touch(double x_m, double d_m) {
    v1::TouchRequest request;
    request.mutable_pose()->add_position_m(x_m);
    request.mutable_pose()->add_position_m(d_m);
    request.mutable_pose()->set_laws_acknowledged(pieces.size());
    EXPECT_TRUE(toucher->send(request));
    v1::TouchResponse response;
    while (toucher->read(&response) && response.has_law()) pieces.push_back(response.law());
    return response.answer();
  }
  std::unique_ptr<Toucher> toucher;
  std::vector<v1::LawPiece> pieces;
};

TEST_F(Laws, AreTheForceOfTheAnswersInSmallPiecesBetweenThem) {
  v1::TouchAnswer answer;
  // Until the columns about the finger, which come first, have come.
  while (pieces.empty()) answer = touch(0.0503, 0.002);
  const v1::LawPiece& first = pieces.front();
  EXPECT_EQ(first.piece(), 1U);
  EXPECT_EQ(first.model_version(), answer.model_version());
  EXPECT_LE(first.ByteSizeLong(), 400U);
  std::vector<LawColumn> columns;
  for (int k = 0; k < first.columns_size(); ++k) columns.push_back(column_from(first, k));
  ASSERT_GE(columns.size(), 2U);
  EXPECT_EQ(first.begin_x_m(), columns.front().x_m);
  EXPECT_EQ(first.end_x_m(), columns.back().x_m);
  const double x_m = (columns[0].x_m + columns[1].x_m) / 2;
  for (const double d_m : {0.0005, 0.002, 0.005}) {
    const LawValue value = evaluate(columns, x_m, d_m);
    answer = touch(x_m, d_m);
    ASSERT_TRUE(value.covered);
    EXPECT_GT(value.error_n, 0);
    EXPECT_NEAR(value.by_x_n, -answer.force_n(0), value.error_n);
    EXPECT_NEAR(value.by_d_n, -answer.force_n(1), value.error_n);
  }
  for (std::size_t k = 0; k < pieces.size(); ++k) EXPECT_EQ(pieces[k].piece(), k + 1);
}

TEST_F(Laws, APieceThatWasNeverSentCannotBeAcknowledged) {
  v1::TouchRequest request;
  request.mutable_pose()->add_position_m(0.05);
  request.mutable_pose()->add_position_m(0.002);
  request.mutable_pose()->set_laws_acknowledged(1'000'000);
  ASSERT_TRUE(toucher->send(request));
  expect_refused(toucher->finish(), grpc::StatusCode::INVALID_ARGUMENT, "pose.laws_acknowledged");
}

}  // namespace
}  // namespace teletact::service
