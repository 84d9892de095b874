// When a call that runs is asked again who makes it, by a clock that is given.
#include "service/rpc/caller.h"

#include <grpcpp/test/server_context_test_spouse.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>

#include "tests/access/access_folder.h"

namespace teletact::service {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

class AskedAgain : public testing::Test {
 protected:
  AskedAgain() {
    shown_.AddClientMetadata("authorization", "Bearer hand-token");
    caller.begin(context_);
    caller.require({Need::kSteer, "s"});
    caller.look(begin);
  }
  // Writes it, and waits until what it says now has been looked at: the first look may have begun before.
  void put(const std::string& entries) {
    folder_.put("access.toml", entries);
    const auto give_up = Caller::Clock::now() + seconds(60);
    for (const auto looked = access->looks(); access->looks() < looked + 2;) {
      ASSERT_LT(Caller::Clock::now(), give_up);
      std::this_thread::sleep_for(milliseconds(2));
    }
  }
  static std::string entry(const std::string& role, const std::string& more = "") {
    return entry_of("hand", role, more);
  }

 private:
  const AccessFolder folder_;
  grpc::ServerContext context_;
  grpc::testing::ServerContextTestSpouse shown_{&context_};

 protected:
  std::atomic<WallClock::duration> later{};
  const std::shared_ptr<const Access> access = std::make_shared<Access>(
      folder_.put("access.toml", entry("operator", "expires = 2026-01-01T01:00:00Z\n")),
      [this] {
        return WallClock::time_point(std::chrono::sys_days(std::chrono::year(2026) / 1 / 1)) + later.load();
      },
      milliseconds(5));
  Caller caller{access};
  const Caller::Clock::time_point begin{std::chrono::hours(1)};
};

TEST_F(AskedAgain, IsKnownByTheNameOfItsEntry) {
  EXPECT_EQ(caller.name(), "hand");
}

TEST_F(AskedAgain, OnceASecond) {
  later = std::chrono::hours(2);
  EXPECT_NO_THROW(caller.look(begin + milliseconds(999)));
  EXPECT_THROW(caller.look(begin + milliseconds(1000)), AccessRefused);
}

TEST_F(AskedAgain, AtOnceByAFileThatHasChanged) {
  put(entry("observer"));
  EXPECT_THROW(caller.look(begin + milliseconds(1)), AccessRefused);
}

TEST_F(AskedAgain, InVainByAFileThatCannotBeRead) {
  put("[[entry]]\nname = ");
  for (int k = 0; k <= 30; ++k) EXPECT_NO_THROW(caller.look(begin + k * milliseconds(100))) << k;
  put(entry("observer"));
  EXPECT_THROW(caller.look(begin + milliseconds(3001)), AccessRefused);
}

// A proxy that looks at one of them lets the other one in.
TEST(Proof, IsRefusedWhereTwoTokensAreSent) {
  for (const char* second : {"Bearer other-token", "Bearer hand-token", "Basic x"}) {
    grpc::ServerContext context;
    grpc::testing::ServerContextTestSpouse shown(&context);
    shown.AddClientMetadata("authorization", "Bearer hand-token");
    EXPECT_TRUE(proof_in(context).token);
    shown.AddClientMetadata("authorization", second);
    try {
      proof_in(context);
      ADD_FAILURE() << "taken with " << second;
    } catch (const AccessRefused& refused) {
      EXPECT_EQ(refused.why, AccessRefused::Why::kUnknown);
      EXPECT_NE(std::string(refused.what()).find("authorization: it was sent twice"), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace teletact::service
