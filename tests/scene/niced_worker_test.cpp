// A thread that does one job after another: in turns of those whose they are, and not at all those taken
// back.
#include "service/scene/niced_worker.h"

#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace teletact::service {
namespace {

// Jobs that wait behind one that ends with go().
class Waiting : public testing::Test {
 protected:
  Waiting() {
    worker.post([going = going.get_future().share()] { going.wait(); });
  }
  NicedWorker::Id post(const std::string& name, const std::string& of) {
    return worker.post([this, name] { done.push_back(name); }, of);
  }
  void go() {
    going.set_value();
    worker.finish();
  }
  std::vector<std::string> done;
  std::promise<void> going;
  NicedWorker worker;
};

TEST_F(Waiting, JobsAreDoneInTurnsOfThoseWhoseTheyAreAndInOrderForEach) {
  for (const char* name : {"a1", "a2", "a3"}) post(name, "a");
  for (const char* name : {"b1", "b2"}) post(name, "b");
  post("c1", "c");
  go();
  EXPECT_EQ(done, (std::vector<std::string>{"a1", "b1", "c1", "a2", "b2", "a3"}));
}

TEST_F(Waiting, AJobThatIsDroppedIsNotDoneAndHoldsNothing) {
  const auto held = std::make_shared<int>();
  const auto dropped = worker.post([this, held] { done.emplace_back("dropped"); }, "a");
  post("other", "a");
  worker.drop(dropped);
  EXPECT_EQ(held.use_count(), 1);
  worker.drop(dropped);  // once more: nothing
  go();
  EXPECT_EQ(done, std::vector<std::string>{"other"});
}

TEST(NicedWorkers, WhoWaitsForAJobThatIsDroppedAtTheEndMayDropItToo) {
  NicedWorker worker;
  std::promise<void> begun, going;
  worker.post([&] {
    begun.set_value();
    going.get_future().wait();
  });
  begun.get_future().wait();
  bool dropped = false;
  std::shared_ptr<void> last(nullptr, [&](void*) {
    worker.drop(2);
    dropped = true;
  });
  EXPECT_EQ(worker.post([last] {}), 2U);
  last.reset();
  std::thread stopping([&] { worker.stop(); });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // it has begun to stop, most likely
  going.set_value();
  stopping.join();
  EXPECT_TRUE(dropped);
}

}  // namespace
}  // namespace teletact::service
