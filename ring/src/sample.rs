//! What a sample of a topic is: a user header, and one message or a list of messages.

use std::fmt::Debug;

use iceoryx2::port::ReceiveError;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::sample::Sample;
use iceoryx2::service::builder::publish_subscribe::{Builder, PublishSubscribeCreateError, PublishSubscribeOpenError};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use skysink_common::message::{QueuesHeader, SlotHeader};

/// User header of a sample, whatever the topic.
pub trait Header: Debug + Default + Copy + ZeroCopySend + 'static {
    /// Mission, slot and flags.
    fn head(&self) -> &SlotHeader;
}

impl Header for SlotHeader {
    fn head(&self) -> &SlotHeader {
        self
    }
}

impl Header for QueuesHeader {
    fn head(&self) -> &SlotHeader {
        &self.head
    }
}

/// One message or a list: what iceoryx2 has twice, by the same names.
pub trait Payload: IceoryxSend + Debug + 'static {
    /// Creates a topic's service with the attributes `terms`.
    ///
    /// # Errors
    /// Those of iceoryx2.
    fn create<S: Service, H: Header>(
        builder: Builder<Self, H, S>,
        terms: &AttributeSpecifier,
    ) -> Result<PortFactory<S, Self, H>, PublishSubscribeCreateError>;

    /// Opens a topic's service.
    ///
    /// # Errors
    /// Those of iceoryx2.
    fn open<S: Service, H: Header>(
        builder: Builder<Self, H, S>,
    ) -> Result<PortFactory<S, Self, H>, PublishSubscribeOpenError>;

    /// The next sample that has arrived.
    ///
    /// # Errors
    /// If the writer's memory cannot be mapped.
    fn receive<S: Service, H: Header>(
        subscriber: &Subscriber<S, Self, H>,
    ) -> Result<Option<Sample<S, Self, H>>, ReceiveError>;
}

/// The same words for a message and for a list.
macro_rules! payload {
    ($payload:ty) => {
        impl<T: Debug + Copy + ZeroCopySend + 'static> Payload for $payload {
            fn create<S: Service, H: Header>(
                builder: Builder<Self, H, S>,
                terms: &AttributeSpecifier,
            ) -> Result<PortFactory<S, Self, H>, PublishSubscribeCreateError> {
                builder.create_with_attributes(terms)
            }

            fn open<S: Service, H: Header>(
                builder: Builder<Self, H, S>,
            ) -> Result<PortFactory<S, Self, H>, PublishSubscribeOpenError> {
                builder.open()
            }

            fn receive<S: Service, H: Header>(
                subscriber: &Subscriber<S, Self, H>,
            ) -> Result<Option<Sample<S, Self, H>>, ReceiveError> {
                subscriber.receive()
            }
        }
    };
}

payload!(T);
payload!([T]);
