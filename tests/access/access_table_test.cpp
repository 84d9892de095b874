#include "service/access/access_table.h"

#include <gtest/gtest.h>

#include <functional>
#include <set>

#include "tests/access/access_folder.h"

namespace teletact::service {
namespace {

using Why = AccessRefused::Why;
const WallClock::time_point kNow{std::chrono::hours(500'000)};

Principal entry(const std::string& name, std::map<std::string, Role> roles) {
  return {.name = name, .token = digest_of(name), .certificate = name + ".test", .roles = std::move(roles)};
}

Proof token(const std::string& text) {
  return {.token = digest_of(text)};
}

void expect_refused(Why why, const std::vector<const char*>& words, const std::function<void()>& ask) {
  try {
    ask();
    ADD_FAILURE() << "let through, not refused with " << words.front();
  } catch (const AccessRefused& refused) {
    EXPECT_EQ(refused.why, why) << refused.what();
    for (const char* word : words)
      EXPECT_NE(std::string(refused.what()).find(word), std::string::npos) << refused.what();
  }
}

// As docs/guide/service.md has it.
TEST(Roles, MayDoWhatTheGuideSays) {
  const std::map<Role, std::set<Need>> may{
      {Role::kPatient, {Need::kKnown, Need::kRead, Need::kPublish, Need::kFollow}},
      {Role::kOperator, {Need::kKnown, Need::kRead, Need::kFeel, Need::kSteer}},
      {Role::kObserver, {Need::kKnown, Need::kRead, Need::kFeel}},
      {Role::kAdministrator,
       {Need::kKnown, Need::kRead, Need::kFeel, Need::kSteer, Need::kPublish, Need::kFollow, Need::kDelete}}};
  for (const auto& [role, needs] : may) {
    for (const Need need : may.at(Role::kAdministrator))
      EXPECT_EQ(allows(role, need), needs.contains(need)) << name_of(role) << " " << words_of(need);
    EXPECT_EQ(role_of(name_of(role)), role);
  }
  EXPECT_EQ(role_of("Operator"), std::nullopt);
  EXPECT_EQ(role_of(""), std::nullopt);
  EXPECT_EQ(roles_for(Need::kSteer), "operator or administrator");
}

TEST(AccessTable, KnowsByTokenOrCertificate) {
  const AccessTable table({entry("anna", {{"*", Role::kOperator}}), entry("ben", {{"*", Role::kPatient}})});
  EXPECT_EQ(table.known(token("anna"), kNow).name, "anna");
  EXPECT_EQ(table.known({.certificate_names = {"other", "ben.test"}}, kNow).name, "ben");
  // A token that is shown counts, whatever certificate the connection has.
  Proof both = token("anna");
  both.certificate_names = {"ben.test"};
  EXPECT_EQ(table.known(both, kNow).name, "anna");
  both.token = digest_of("stale");
  expect_refused(Why::kUnknown, {"token is not known", "--token-file"}, [&] { table.known(both, kNow); });
  expect_refused(Why::kUnknown, {"requires authentication", "--token-file", "--tls-certificate"},
                 [&] { table.known({}, kNow); });
  expect_refused(Why::kUnknown, {"no entry", "carl.test"},
                 [&] { table.known({.certificate_names = {"carl.test"}}, kNow); });
  // Neither a name nor a digest is a token.
  expect_refused(Why::kUnknown, {"token is not known"},
                 [&] { table.known(token(hex_of(digest_of("anna"))), kNow); });
}

TEST(AccessTable, AnEntryOrACertificateEndsAtItsTime) {
  Principal principal = entry("anna", {{"*", Role::kOperator}});
  principal.expires = kNow;
  const AccessTable table({principal, entry("ben", {{"*", Role::kPatient}})});
  const auto moment = std::chrono::milliseconds(1);
  EXPECT_EQ(table.known(token("anna"), kNow - moment).name, "anna");
  expect_refused(Why::kUnknown, {"anna", "expired at 2027-01-15T08:00:00Z"},
                 [&] { table.known(token("anna"), kNow); });
  Proof shown{.certificate_names = {"ben.test"}, .certificate_ends = kNow};
  EXPECT_EQ(table.known(shown, kNow - moment).name, "ben");
  expect_refused(Why::kUnknown, {"certificate of ben ended", "--tls-certificate"},
                 [&] { table.known(shown, kNow); });
}

TEST(AccessTable, ASceneOfItsOwnGoesBeforeEveryScene) {
  const AccessTable table({entry("anna", {{"liver", Role::kOperator}, {"*", Role::kObserver}}),
                           entry("ben", {{"liver", Role::kPatient}})});
  const Principal& anna = table.known(token("anna"), kNow);
  EXPECT_TRUE(AccessTable::may(anna, {Need::kSteer, "liver"}));
  EXPECT_FALSE(AccessTable::may(anna, {Need::kSteer, "kidney"}));
  EXPECT_TRUE(AccessTable::may(anna, {Need::kFeel, "kidney"}));
  expect_refused(Why::kDenied, {"anna", "observer there", "steer", "'kidney'", "operator or administrator"},
                 [&] {
                   AccessTable::require(anna, {Need::kSteer, "kidney"});
                 });
  const Principal& ben = table.known(token("ben"), kNow);
  EXPECT_TRUE(AccessTable::may(ben, {Need::kPublish, "liver"}));
  EXPECT_FALSE(AccessTable::may(ben, {Need::kRead, "kidney"}));
  expect_refused(Why::kDenied, {"ben", "no role there", "'kidney'"}, [&] {
    AccessTable::require(ben, {Need::kRead, "kidney"});
  });
  // No scene: a role anywhere will do. Scenes that have no name yet: one for every scene.
  EXPECT_TRUE(AccessTable::may(ben, {Need::kPublish, ""}));
  EXPECT_FALSE(AccessTable::may(ben, {Need::kDelete, ""}));
  EXPECT_FALSE(AccessTable::may(ben, {Need::kPublish, kEveryScene}));
}

// The message is gRPC's status: what a peer calls a scene must not make it long or of two lines.
TEST(AccessTable, WhatAPeerCallsASceneIsCut) {
  const AccessTable table({entry("ben", {{"liver", Role::kPatient}})});
  try {
    AccessTable::require(table.known(token("ben"), kNow), {Need::kRead, "a\n\"" + std::string(100'000, 'x')});
    FAIL();
  } catch (const AccessRefused& refused) {
    EXPECT_LT(std::string(refused.what()).size(), 300U);
    EXPECT_EQ(std::string(refused.what()).find_first_of("\n\""), std::string::npos);
  }
}

TEST(AccessTable, EntriesThatCannotBeToldApartAreRefused) {
  const std::map<std::string, Role> roles{{"*", Role::kObserver}};
  const auto refused = [](std::vector<Principal> entries) -> std::string {
    try {
      AccessTable table(std::move(entries));
      return "";
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
  };
  EXPECT_EQ(refused({entry("a", roles), entry("b", roles)}), "");
  Principal again = entry("b", roles);
  again.token = digest_of("a");
  EXPECT_NE(refused({entry("a", roles), again}).find("entry 'b': token_sha256"), std::string::npos);
  again = entry("b", roles);
  again.certificate = "a.test";
  EXPECT_NE(refused({entry("a", roles), again}).find("entry 'b': certificate"), std::string::npos);
  EXPECT_NE(refused({entry("a", roles), entry("a", roles)}).find("entry 'a': name"), std::string::npos);
  EXPECT_NE(refused({{.name = "a", .roles = roles}}).find("token_sha256"), std::string::npos);
  EXPECT_NE(refused({entry("a", {})}).find("roles"), std::string::npos);
}

TEST(Token, IsKeptAsItsHash) {
  // sha256("abc"), FIPS 180-2.
  EXPECT_EQ(hex_of(digest_of("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(digest_from(hex_of(digest_of("abc"))), digest_of("abc"));
  EXPECT_EQ(digest_from(std::string(63, 'a')), std::nullopt);
  EXPECT_EQ(digest_from("g" + std::string(63, 'a')), std::nullopt);
  EXPECT_EQ(digest_from("-1" + std::string(62, 'a')), std::nullopt);
}

}  // namespace
}  // namespace teletact::service
