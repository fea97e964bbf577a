//! The samples of a topic: a user header, and one message or a list of messages.

use std::fmt::Debug;

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::{ReceiveError, SendError};
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use skysink_common::message::{QueuesHeader, SensorsHeader, SlotHeader};
use skysink_common::possible::Message;

/// User header of a sample of any topic.
pub trait Header: Message + Debug + Default + Copy + ZeroCopySend + 'static {
    /// Mission, slot and flags.
    fn head(&self) -> &SlotHeader;

    /// Mission, slot and flags, mutable.
    fn head_mut(&mut self) -> &mut SlotHeader;
}

/// Implements [`Header`] for a header, given where its [`SlotHeader`] is.
macro_rules! header {
    ($header:ty, $this:ident => $head:expr) => {
        impl Header for $header {
            fn head(&self) -> &SlotHeader {
                let $this = self;
                &$head
            }

            fn head_mut(&mut self) -> &mut SlotHeader {
                let $this = self;
                &mut $head
            }
        }
    };
}

header!(SlotHeader, header => *header);
header!(QueuesHeader, header => header.head);
header!(SensorsHeader, header => header.head);

/// One message or a list of messages, which are separate types with the same methods in iceoryx2.
pub trait Payload: IceoryxSend + Debug + 'static {
    /// A message.
    type Message: Message + Debug + Copy;

    /// The messages of a sample, of which there is one unless the payload is a list.
    fn messages<S: Service, H: Header>(sample: &Sample<S, Self, H>) -> &[Self::Message];

    /// Sends a copy of `messages`, of which there is one unless the payload is a list.
    ///
    /// # Errors
    /// If iceoryx2 fails.
    fn send<S: Service, H: Header>(
        publisher: &Publisher<S, Self, H>,
        header: H,
        messages: &[Self::Message],
    ) -> Result<(), SendError>;

    /// Creates a topic's service with the attributes `terms`, or opens it if there are none.
    ///
    /// # Errors
    /// If iceoryx2 fails.
    fn service<S: Service, H: Header>(
        builder: Builder<Self, H, S>,
        terms: Option<&AttributeSpecifier>,
    ) -> Result<PortFactory<S, Self, H>, Box<dyn Debug>>;

    /// Receives the next sample, if there is one.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    fn receive<S: Service, H: Header>(
        subscriber: &Subscriber<S, Self, H>,
    ) -> Result<Option<Sample<S, Self, H>>, ReceiveError>;
}

/// Implements [`Payload`] for a message or a list, given its slice and how a sample of `messages` is made.
macro_rules! payload {
    ($payload:ty, $slice:expr, $publisher:ident, $messages:ident => $sample:expr) => {
        impl<T: Message + Debug + Copy + ZeroCopySend + 'static> Payload for $payload {
            type Message = T;

            fn messages<S: Service, H: Header>(sample: &Sample<S, Self, H>) -> &[T] {
                $slice(sample.payload())
            }

            fn send<S: Service, H: Header>(
                $publisher: &Publisher<S, Self, H>,
                header: H,
                $messages: &[T],
            ) -> Result<(), SendError> {
                let mut sample = $sample;
                *sample.user_header_mut() = header;
                sample.send().map(drop)
            }

            fn service<S: Service, H: Header>(
                builder: Builder<Self, H, S>,
                terms: Option<&AttributeSpecifier>,
            ) -> Result<PortFactory<S, Self, H>, Box<dyn Debug>> {
                match terms {
                    Some(terms) => builder.create_with_attributes(terms).map_err(|error| Box::new(error) as _),
                    None => builder.open().map_err(|error| Box::new(error) as _),
                }
            }

            fn receive<S: Service, H: Header>(
                subscriber: &Subscriber<S, Self, H>,
            ) -> Result<Option<Sample<S, Self, H>>, ReceiveError> {
                subscriber.receive()
            }
        }
    };
}

payload!(T, std::slice::from_ref, publisher, messages => publisher.loan_uninit()?.write_payload(messages[0]));
payload!([T], std::convert::identity, publisher, messages => {
    publisher.loan_slice_uninit(messages.len())?.write_from_slice(messages)
});
