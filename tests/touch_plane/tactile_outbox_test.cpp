// Tactile images of a stream: beside its answers, at a rate of their own.
#include "service/touch_plane/tactile_outbox.h"

#include <gtest/gtest.h>

#include <numeric>
#include <stdexcept>
#include <thread>
#include <variant>
#include <vector>

#include "service/base/choices.h"
#include "service/touch_plane/touch_stream.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

using Clock = TactileOutbox::Clock;

TactileImage image_of(double force_n) {
  TactileImage image;
  image.pressure.force_n = force_n;
  return image;
}

TEST(TactileOutbox, ImagesAreBegunOneAtATimeAndAPeriodApart) {
  std::vector<std::function<void()>> jobs;
  const TouchWork later = [&](const std::string& client, std::function<void()> job) {
    EXPECT_EQ(client, "c");
    jobs.push_back(std::move(job));
  };
  TactileOutbox outbox({});
  const auto begin = Clock::now();
  ASSERT_TRUE(outbox.due(begin));
  outbox.begin(
      begin, 7, [] { return image_of(0.1); }, later, "c");
  EXPECT_FALSE(outbox.take()) << "it is not made yet";
  EXPECT_FALSE(outbox.due(begin + 10 * choices::kTactilePeriod)) << "one at a time";
  jobs.front()();
  jobs.clear();
  EXPECT_FALSE(outbox.due(begin + choices::kTactilePeriod / 2));
  EXPECT_TRUE(outbox.due(begin + choices::kTactilePeriod));
  const auto sent = outbox.take();
  ASSERT_TRUE(sent);
  EXPECT_EQ(sent->sequence, 7u);
  EXPECT_EQ(sent->image.pressure.force_n, 0.1);
  EXPECT_FALSE(outbox.take()) << "once";
}

TEST(TactileOutbox, AnImageThatIsNeverBegunIsNotWaitedFor) {
  TactileOutbox outbox({});
  const auto begin = Clock::now();
  const TouchWork full = [](const std::string&, const std::function<void()>&) {
    throw std::runtime_error("no room");
  };
  EXPECT_ANY_THROW(outbox.begin(
      begin, 1, [] { return image_of(0.1); }, full, "c"));
  EXPECT_TRUE(outbox.due(begin + choices::kTactilePeriod));
}

TEST(TactileOutbox, RefusesWhatCannotBeShown) {
  const auto words = [](const TaxelGrid& grid) -> std::string {
    try {
      TactileOutbox outbox(grid);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(words({}), "");
  EXPECT_EQ(words({32, 1, 0.0005}), "");
  EXPECT_NE(words({33, 8, 0.002}).find("open.tactile.taxels_x: 33"), std::string::npos);
  EXPECT_NE(words({8, 0, 0.002}).find("open.tactile.taxels_z: 0"), std::string::npos);
  for (const double pitch : {0.0004, 0.011, -0.002, double(NAN)})
    EXPECT_NE(words({8, 8, pitch}).find("open.tactile.pitch_m"), std::string::npos) << pitch;
}

class TactileStream : public testing::Test {
 protected:
  TouchStream::Answered touch(TouchStream& stream, double y_m) {
    stream.bring({++sequence_, stream.counts().answers, {0.03, y_m, 0}, {}});
    while (true) {
      std::this_thread::sleep_until(stream.due());
      const TouchStream::Said said = stream.turn();
      stream.written();
      if (const auto* answered = std::get_if<TouchStream::Answered>(&said)) return *answered;
    }
  }
  static TouchStreamOptions wishes() {
    TouchStreamOptions wishes{"hand", 8, 0, {}};
    wishes.tactile = TaxelGrid{};
    return wishes;
  }
  const std::shared_ptr<Scene> scene = given_scene(60, 20);
  const CurrentDevice no_device{nullptr};

 private:
  std::uint64_t sequence_ = 0;
};

// A plane's finger is 10 mm wide along z: five taxels, the same in each.
TEST_F(TactileStream, OfAPlaneSceneTheImageIsAsWideAsItsThickness) {
  TouchStream stream(scene, wishes(), no_device);
  const TouchStream::Answered answered = touch(stream, 0.002);
  ASSERT_TRUE(answered.tactile) << "in place where nobody else makes it";
  EXPECT_EQ(answered.tactile->sequence, 1u);
  const TactileImage& image = answered.tactile->image;
  EXPECT_TRUE(image.beyond_pa.empty()) << "a plane model does not know it";
  const std::vector<double>& p = image.pressure.pressure_pa;
  const double force = std::accumulate(p.begin(), p.end(), 0.0) * 4e-6;
  EXPECT_NEAR(force + image.pressure.outside_n, image.pressure.force_n, 1e-12);
  EXPECT_NEAR(force, -answered.answer.contact.force_n[1], 0.02 * force) << "but for the skin's part";
  EXPECT_GT(p[3 * 8 + 3], 0);
  for (const std::size_t row : {2, 4, 5})
    EXPECT_NEAR(p[row * 8 + 3], p[3 * 8 + 3], 1e-9 * p[3 * 8 + 3]) << row;
  EXPECT_NEAR(p[1 * 8 + 3], 0.5 * p[3 * 8 + 3], 1e-9 * p[3 * 8 + 3]);
  EXPECT_EQ(p[3], 0) << "beyond 5 mm";
  EXPECT_TRUE(answered.answer.contact.pressure.empty()) << "nodal pressures were not asked for";
}

TEST_F(TactileStream, IsBlankOutOfContactAndNotThereWhereNobodyAsks) {
  TouchStream stream(scene, wishes(), no_device), plain(scene, {"other", 8, 0, {}}, no_device);
  const TouchStream::Answered above = touch(stream, -0.001);
  ASSERT_TRUE(above.tactile);
  EXPECT_EQ(above.tactile->image.pressure.pressure_pa, std::vector<double>(64, 0.0));
  EXPECT_FALSE(touch(plain, 0.002).tactile);
}

// Whoever makes images is busy: answers do without.
TEST_F(TactileStream, NoAnswerWaitsForAnImage) {
  std::vector<std::function<void()>> jobs;
  scene->set_touch_work(
      [&](const std::string&, std::function<void()> job) { jobs.push_back(std::move(job)); });
  TouchStream stream(scene, wishes(), no_device);
  auto answered = touch(stream, 0.002);
  for (std::size_t k = 0; answered.answer.status == TouchStatus::kPreparing; ++k) {
    ASSERT_LT(k, jobs.size()) << "its layer is made ready by what was asked for";
    jobs[k]();
    answered = touch(stream, 0.002);
  }
  EXPECT_FALSE(answered.tactile);
  const std::size_t asked = jobs.size();
  EXPECT_EQ(touch(stream, 0.003).answer.status, TouchStatus::kOk);
  EXPECT_EQ(jobs.size(), asked) << "one image at a time";
  jobs.back()();
  const auto with = touch(stream, 0.003);
  ASSERT_TRUE(with.tactile);
  EXPECT_GT(with.tactile->image.pressure.force_n, 0);
}

}  // namespace
}  // namespace teletact::service
