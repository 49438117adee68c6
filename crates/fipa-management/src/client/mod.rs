//! The other side: requests to an AMS or a DF, and what their answers say.
//!
//! A request is complete but for its sender and what ties its answer to it: conversation-id,
//! reply-with and reply-by.
//!
//! ```
//! use fipa_acl::AgentId;
//! use fipa_management::{DfAgentDescription, SearchConstraints, ServiceDescription, client};
//!
//! let df = AgentId::new("df@platA").address("http://127.0.0.1:7778/acc");
//! let template = DfAgentDescription::default().service(ServiceDescription::of_type("weather"));
//! let request = client::df_search_request(&df, &template, &SearchConstraints::all())
//!     .from_agent("fipa-1@robot1")
//!     .conversation_id("c-1")
//!     .reply_with("r-1");
//! assert!(request.content_str().unwrap().contains("(service-description :type weather)"));
//! ```

mod answers;
mod federation;
mod platforms;
mod requests;

pub(crate) use answers::MORE;
pub use answers::{
    AnswerError, agents_result, description_result, done, has_more, notification, registered,
    search_result,
};
pub use federation::{df_federate_request, df_leave_request};
pub use platforms::{platform_answer, platform_request, platform_result, requested_platform};
pub use requests::{
    ams_deregister_request, ams_description_request, ams_register_request, ams_search_request,
    df_cancel_request, df_deregister_request, df_modify_request, df_register_request,
    df_search_request, df_subscribe_request,
};
