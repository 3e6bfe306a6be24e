//! `gs blocks`: trains a large scene in blocks.

mod arguments;
mod folder_and_views;
mod merge;
mod prepare;
mod status;
mod submit;
mod work;

use self::arguments::BlocksAction;
pub(crate) use self::arguments::BlocksArgs;
use crate::failure::Failure;

/// Does an action.
pub(crate) fn run(args: &BlocksArgs) -> Result<(), Failure> {
    match &args.action {
        BlocksAction::Prepare(args) => prepare::run(args),
        BlocksAction::Work(args) => work::run(args),
        BlocksAction::Submit(args) => submit::run(args),
        BlocksAction::Status(args) => status::run(args),
        BlocksAction::Merge(args) => merge::run(args),
    }
}
